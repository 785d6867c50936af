//! COLMAP's dense workspace: images, a model without points, depth maps.

use super::RecordingError;
use super::source::{Source, intrinsics, joined};

pub(super) fn write(source: &Source<'_>) -> Result<(), RecordingError> {
    for folder in ["images", "sparse", "stereo/depth_maps"] {
        source.make_folder(folder)?;
    }
    let mut images = String::from("# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n");
    let size = source.depth_size();
    for index in 0..source.count() {
        let extension = source.write_picture(index, &format!("images/{index:06}"))?;
        let name = format!("{index:06}.{extension}");
        let mut map = format!("{}&{}&1&", size.width, size.height).into_bytes();
        let depth = source.depth(index)?;
        map.extend(depth.samples().iter().flat_map(|value| value.to_le_bytes()));
        source.write(&format!("stereo/depth_maps/{name}.geometric.bin"), &map)?;
        let pose = source.pose(index).inverse();
        let (q, t) = (pose.rotation.coords, pose.translation.vector);
        let numbers = joined(&[q.w, q.x, q.y, q.z, t.x, t.y, t.z]);
        images += &format!("{} {numbers} 1 {name}\n\n", index + 1);
    }
    source.write("sparse/images.txt", images.as_bytes())?;
    let size = source.size();
    let [fx, fy, cx, cy] = intrinsics(source.camera());
    // The centre of the first pixel is (0.5, 0.5).
    let numbers = joined(&[fx, fy, cx + 0.5, cy + 0.5]);
    let cameras = format!("1 PINHOLE {} {} {numbers}\n", size.width, size.height);
    source.write("sparse/cameras.txt", cameras.as_bytes())?;
    source.write(
        "sparse/points3D.txt",
        b"# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n",
    )
}
