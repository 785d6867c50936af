//! The tables of the configuration and their keys.
//!
//! The descriptions are those of `docs/configuration.md`. Defaults are those of [`Options`].

use linecarve_mesh::diff::Tolerance;
use serde::{Deserialize, Serialize};

use super::table::{Key, Number, OutOfRange, Setting, Table, Values, table};
use super::tolerance;
use crate::options::{HoleFilling, LabelKind, Options};

const FLAG: Values = Values::any("true or false");

table! {
    /// The parameters that users set.
    [""] Configuration {}
    tables {
        /// Choice of keyframes.
        keyframes: KeyframesTable,
        /// Size of images.
        images: ImagesTable,
        /// The depth camera.
        sensor: SensorTable,
        /// Depth from images.
        semi_dense: SemiDenseTable,
        /// Correction of poses.
        pose_correction: PoseCorrectionTable,
        /// Points from ORB features.
        map_points: MapPointsTable,
        /// Free space.
        carving: CarvingTable,
        /// The surface.
        surface: SurfaceTable,
        /// Simplification of the final mesh.
        simplify: SimplifyTable,
    }
}

table! {
    /// Choice of keyframes among the frames of a sequence. `stream` uses it for frames without poses: a `keyframe` message always is one.
    ["keyframes"] KeyframesTable {
        /// Motion since the last keyframe after which a frame becomes a keyframe, in the unit of the poses.
        /// Without this key it is 8 % of the median scene depth.
        /// Set it lower for more detail and a longer run. The flag `--min-translation` overrides it.
        #[serde(skip_serializing_if = "Option::is_none")]
        translation: Option<f64> = keyframes.translation, Values::range(0.0, 1e9, "a number from 0 to 1000000000");
        /// Rotation since the last keyframe after which a frame becomes a keyframe, in degrees.
        /// Set it lower for a camera that mostly turns. The flag `--min-rotation` overrides it.
        rotation_degrees: f64 = keyframes.rotation_degrees, Values::range(0.0, 360.0, "a number from 0 to 360");
        /// Number of frames, from the one that has moved enough, of which the sharpest becomes the keyframe.
        /// 1 takes the first. Set it higher for a hand-held camera with motion blur. The flag `--sharpness-window`
        /// overrides it.
        sharpness_window: usize = keyframes.sharpness_window, Values::range(1.0, 1000.0, "a whole number from 1 to 1000");
    }
    tables {}
}

table! {
    /// Size of images.
    ["images"] ImagesTable {
        /// Longest side of an image, in pixels. Larger images are scaled by a whole fraction; 0 never scales.
        /// Images to whose pixels depth is registered are never scaled. Set it lower for a faster run: the time of depth
        /// from images grows with the third power. The flag `--max-image-size` overrides it.
        longest_side_px: u32 = images.longest_side_px, Values::range(0.0, 65536.0, "a whole number from 0 to 65536");
    }
    tables {}
}

table! {
    /// The depth camera.
    ["sensor"] SensorTable {
        /// Standard deviation of a depth at the median scene depth, as a share of that depth. The deviation of inverse
        /// depth is the same everywhere.
        /// The default is that of structured light at room distance. Set it to that of your camera.
        relative_noise: f64 = sensor.relative_noise, Values::range(1e-6, 1.0, "a number from 0.000001 to 1");
    }
    tables {}
}

table! {
    /// Depth from neighbouring keyframes, where there are no depth images or with `--depth semi-dense`.
    ["semi_dense"] SemiDenseTable {
        /// Keyframes before a keyframe that may be its neighbours.
        /// Set it lower to hold fewer images in memory: `past + future + 1` keyframes are held.
        past: usize = semi_dense.past, Values::range(0.0, 1000.0, "a whole number from 0 to 1000");
        /// Keyframes after a keyframe that may be its neighbours. The last of them is awaited before its depth is final.
        /// Set it lower for final depth sooner in a stream, at a loss of depth.
        future: usize = semi_dense.future, Values::range(0.0, 1000.0, "a whole number from 0 to 1000");
        /// Whether depth is measured between edges, too.
        /// Set it to false for a faster run and a surface from edges alone.
        between_edges: bool = semi_dense.is_dense, FLAG;
    }
    tables {
        /// Matches of edge pixels.
        #[serde(rename = "match")]
        matching: MatchTable,
    }
}

table! {
    /// Matches of edge pixels in neighbouring keyframes.
    ["semi_dense.match"] MatchTable {
        /// Least number of neighbours that agree on the depth of an edge pixel.
        /// Set it to 3 for fewer and more reliable depths.
        least_agreeing: usize = semi_dense.matching.least_agreeing, Values::range(1.0, 1000.0, "a whole number from 1 to 1000");
    }
    tables {}
}

table! {
    /// Correction of poses by the images, and of poses and depth by the depth images.
    ["pose_correction"] PoseCorrectionTable {
        /// Whether poses are corrected where the images contradict them, and poses and depth where depth images contradict each other.
        /// Set it to false for poses that are exact or that must not change.
        enabled: bool = pose_correction.enabled, FLAG;
        /// Whether focal lengths, principal point and distortion are corrected where that explains the images, if the calibration calls
        /// them undistorted.
        /// Set it to false when the calibration is known to be right.
        lens: bool = pose_correction.lens, FLAG;
        /// Standard deviation of the given poses, in rotation and in translation, in pixels of the image at the median scene depth.
        /// Set it lower for poses that are better than 3 pixels, higher for poses that drift.
        sigma_px: f64 = pose_correction.sigma_px, Values::range(1e-3, 1e3, "a number from 0.001 to 1000");
    }
    tables {}
}

table! {
    /// Map points, for `--from map-points` and `compare`.
    ["map_points"] MapPointsTable {
        /// Number of ORB features sought in an image.
        /// Set it higher for large images with fine texture; the run takes longer.
        features: usize = map_points.features, Values::range(1.0, 1e5, "a whole number from 1 to 100000");
        /// Least number of keyframes that see a point that is carved.
        /// Set it to 2 for sequences with few views, higher for fewer wrong points.
        min_views: usize = map_points.min_views, Values::range(2.0, 1e4, "a whole number from 2 to 10000");
        /// Least number of views of a model that see a point that is carved. 0: 2 in dense clouds and in models whose points mostly have
        /// no more, 3 in others.
        /// Set it to 2 for models with few views, higher for fewer wrong points.
        min_model_views: usize = point_model.min_views, Values::range(0.0, 1e4, "a whole number from 0 to 10000");
        /// Largest standard deviation of the position of a point, as a share of its distance from the nearest keyframe that sees it.
        /// Set it lower for fewer and more accurate points; the surface then has more holes.
        max_relative_sigma: f64 = map_points.max_relative_sigma, Values::range(1e-6, 1.0, "a number from 0.000001 to 1");
    }
    tables {}
}

table! {
    /// Free space: how tetrahedra are labelled free or occupied.
    ["carving"] CarvingTable {
        /// Method. `"cut"` finds the labels of least energy by a minimum cut with soft visibility and withstands wrong points.
        /// `"votes"` counts rays: it is faster, and leaves more spikes. The flag `--labels` overrides it.
        labels: LabelKind = carving.labels, Values::any("\"votes\" or \"cut\"");
        /// With votes, least number of rays through a tetrahedron that is free.
        /// Set it higher when wrong points cut holes into the surface.
        free_threshold: u32 = carving.free_threshold, Values::range(1.0, 1e6, "a whole number from 1 to 1000000");
    }
    tables {
        /// Weights of the minimum cut.
        cut: CutTable,
    }
}

table! {
    /// Weights of the minimum cut.
    ["carving.cut"] CutTable {
        /// Distance behind a point at which space is occupied, in standard deviations of the point.
        /// Set it higher for noisy points; thin objects then become thicker.
        behind_sigmas: f64 = carving.cut.behind_sigmas, Values::range(0.0, 100.0, "a number from 0 to 100");
        /// Weight of the occupied space behind a point, as a share of the weight of its rays. It grows with the rays: as given up to 3 of
        /// them, 8/3 of it from 8 on.
        /// Set it higher against holes, lower against surface that spans free space.
        matter_weight: f64 = carving.cut.matter_weight, Values::range(0.0, 16.0, "a number from 0 to 16");
        /// Weight of the shape of triangles: long thin triangles cost more.
        /// Set it to 0.2 to 0.5 for sparse or unreliable points; the surface then loses detail.
        quality_weight: f64 = carving.cut.quality_weight, Values::range(0.0, 256.0, "a number from 0 to 256");
    }
    tables {}
}

table! {
    /// The surface that is written: which triangles are left out.
    ["surface"] SurfaceTable {
        /// Without depth images, longest edge of a triangle, as a share of the median scene depth; 0 keeps all triangles. Where
        /// depth is measured between edges (`semi_dense.between_edges`), 0.11 is the largest that counts.
        /// Set it lower against triangles that span gaps, higher for a more closed surface.
        longest_edge_share: f64 = surface.longest_edge_share, Values::range(0.0, 1e6, "a number from 0 to 1000000");
        /// Where depth is dense, least share of a triangle along which keyframes measured the surface. Of those below it, only a measured part beside an edge is kept; 0 keeps all triangles.
        /// Set it lower for a more closed surface, higher against surface that no keyframe measured.
        least_measured_share: f64 = surface.least_measured_share, Values::range(0.0, 1.0, "a number from 0 to 1");
        /// Least number of triangles of a connected component.
        /// Set it higher against loose pieces.
        minimum_component: usize = surface.minimum_component, Values::range(0.0, 1e9, "a whole number from 0 to 1000000000");
        /// Holes that are closed: `"all"` closes any of the final mesh with up to 400 edges, `"measured"` gaps of a single triangle amid others
        /// that depth confirms, `"none"` none.
        /// Set it to `"all"` for a mesh that has to be closed: surface is then invented where nothing was measured.
        holes: HoleFilling = surface.holes, Values::any("\"none\", \"measured\" or \"all\"");
    }
    tables {}
}

table! {
    /// Simplification of the final mesh of `reconstruct`.
    ["simplify"] SimplifyTable {
        /// Largest distance between the mesh and the simplified mesh: a length in the unit of the poses (`0.002`), or a share
        /// of the diagonal of the mesh (`"0.02%"`). Without this key the mesh is not simplified.
        /// Set it for a smaller file. The flag `--simplify` overrides it.
        #[serde(with = "tolerance", skip_serializing_if = "Option::is_none")]
        tolerance: Option<Tolerance> = simplify.tolerance,
            Values::range(1e-9, 1e9, "a length above 0 such as 0.002, or a share of the diagonal such as \"0.02%\"");
        /// Largest distance by which boundary edges move within the surface: a length, or a share of the diagonal; 0 holds them to the
        /// tolerance.
        /// Without this key it is half the median length of boundary edges, at most 20 tolerances. Set it lower for
        /// boundaries that follow the data.
        #[serde(with = "tolerance", skip_serializing_if = "Option::is_none")]
        boundary_tolerance: Option<Tolerance> = simplify.boundary_tolerance,
            Values::range(0.0, 1e9, "a length such as 0.01, or a share of the diagonal such as \"0.1%\"");
    }
    tables {}
}
