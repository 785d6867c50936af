//! Files of other programs that are not read: what they are, and how to bring them in. One table has all of them.

use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Bytes at the beginning of a file that tell what it is.
const HEAD: u64 = 4096;

/// A kind of file.
#[derive(Debug, Clone, Copy)]
pub(super) struct ForeignKind {
    /// What such a file is, with its article.
    pub(super) what: &'static str,
    /// How to bring it in; `{path}` stands for its path.
    remedy: &'static str,
    is_one: fn(&Start<'_>) -> bool,
}

/// The beginning of a file, and its name.
struct Start<'a> {
    bytes: &'a [u8],
    /// In lower case.
    name: &'a str,
}

impl Start<'_> {
    fn starts(&self, magic: &[u8]) -> bool {
        self.bytes.starts_with(magic)
    }

    fn at(&self, at: usize, magic: &[u8]) -> bool {
        self.bytes
            .get(at..)
            .is_some_and(|rest| rest.starts_with(magic))
    }

    fn ends(&self, extensions: &[&str]) -> bool {
        extensions.iter().any(|end| self.name.ends_with(end))
    }

    fn holds(&self, text: &str) -> bool {
        self.bytes
            .windows(text.len())
            .any(|window| window == text.as_bytes())
    }
}

const TO_MP4: &str =
    "convert it to MP4 with ffmpeg -i {path} -c:v libx264 OUT.mp4, and give OUT.mp4";
const TO_COLMAP: &str =
    "export a COLMAP model (cameras.txt and images.txt), and give its folder with the images";
const BAG: &str = "extract its images, depth images and poses to files (images/, depth/ and a trajectory 'stamp tx ty tz qx qy qz qw'), \
                   and give that folder with --poses FILE";

/// All kinds; the first that fits is taken.
#[rustfmt::skip]
pub(super) static KINDS: [ForeignKind; 25] = [
    ForeignKind { what: "a WebM video", remedy: TO_MP4, is_one: |f| f.starts(&[0x1A, 0x45, 0xDF, 0xA3]) && f.holds("webm") },
    ForeignKind { what: "a Matroska video", remedy: TO_MP4, is_one: |f| f.starts(&[0x1A, 0x45, 0xDF, 0xA3]) },
    ForeignKind { what: "an AVI video", remedy: TO_MP4, is_one: |f| f.starts(b"RIFF") && f.at(8, b"AVI ") },
    ForeignKind { what: "an MPEG transport stream", remedy: TO_MP4, is_one: |f| f.starts(b"G") && f.at(188, b"G") && f.at(376, b"G") },
    ForeignKind { what: "an MPEG program stream", remedy: TO_MP4, is_one: |f| f.starts(&[0, 0, 1, 0xBA]) },
    ForeignKind { what: "a Flash video", remedy: TO_MP4, is_one: |f| f.starts(b"FLV\x01") },
    ForeignKind { what: "a Windows Media video", remedy: TO_MP4, is_one: |f| f.starts(&[0x30, 0x26, 0xB2, 0x75, 0x8E, 0x66, 0xCF, 0x11]) },
    ForeignKind { what: "an Ogg video", remedy: TO_MP4, is_one: |f| f.starts(b"OggS") },
    ForeignKind { what: "a raw stream of H.264 or H.265, without times", remedy: "wrap it with ffmpeg -framerate 30 -i {path} -c copy OUT.mp4 (with its own \
        rate), and give OUT.mp4", is_one: |f| f.starts(&[0, 0, 0, 1]) || f.starts(&[0, 0, 1]) },
    ForeignKind { what: "an animated GIF", remedy: TO_MP4, is_one: |f| f.starts(b"GIF8") },
    ForeignKind { what: "a bag of ROS 1", remedy: BAG, is_one: |f| f.starts(b"#ROSBAG") },
    ForeignKind { what: "an MCAP recording, as of ROS 2", remedy: BAG, is_one: |f| f.starts(b"\x89MCAP") },
    ForeignKind { what: "a log of Kintinuous or ElasticFusion", remedy: BAG, is_one: |f| f.ends(&[".klg"]) },
    ForeignKind { what: "a database of ROS 2", remedy: BAG, is_one: |f| f.starts(b"SQLite format 3") && f.ends(&[".db3"]) },
    ForeignKind { what: "an SQLite database", remedy: "of COLMAP: run its mapper, and give the folder with images/ and sparse/; of RTAB-Map: \
        export poses (rtabmap-export --poses --images {path}), and give that folder", is_one: |f| f.starts(b"SQLite format 3") },
    ForeignKind { what: "a reconstruction of OpenSfM", remedy: "run bin/opensfm export_colmap DATASET, and give the folder with the images",
        is_one: |f| f.ends(&[".json"]) && f.holds("\"projection_type\"") },
    ForeignKind { what: "a scene of OpenMVG", remedy: "run openMVG_main_openMVG2Colmap -i {path} -o OUT, and give OUT with the images",
        is_one: |f| f.holds("\"sfm_data_version\"") },
    ForeignKind { what: "a scene of Meshroom (AliceVision)", remedy: "run aliceVision_exportColmap -i {path} -o OUT, and give OUT",
        is_one: |f| f.ends(&[".sfm"]) || (f.ends(&[".json"]) && f.holds("\"poses\"") && f.holds("\"views\"")) },
    ForeignKind { what: "a model of Bundler", remedy: TO_COLMAP, is_one: |f| f.starts(b"# Bundle file") },
    ForeignKind { what: "a camera file of Metashape", remedy: "choose Export Cameras with the type COLMAP in Metashape, and give that folder",
        is_one: |f| f.ends(&[".xml"]) && f.holds("<document") && f.holds("<chunk") },
    ForeignKind { what: "a ZIP archive", remedy: "unpack it, and give the folder", is_one: |f| f.starts(b"PK\x03\x04") },
    ForeignKind { what: "a gzip archive", remedy: "unpack it, and give the folder", is_one: |f| f.starts(&[0x1F, 0x8B]) },
    ForeignKind { what: "a single image", remedy: "give the folder with all images of the sequence", is_one: |f| {
        f.starts(b"\x89PNG") || f.starts(&[0xFF, 0xD8, 0xFF]) || f.starts(b"II*\0") || f.starts(b"MM\0*") || f.starts(b"BM")
            || (f.starts(b"RIFF") && f.at(8, b"WEBP")) } },
    ForeignKind { what: "a mesh or a cloud", remedy: "it has no images to reconstruct from: linecarve render draws it, evaluate measures it, convert changes \
        its format, and linecarve mesh --cameras makes a mesh of points with normals", is_one: |f| f.starts(b"ply") || f.starts(b"glTF") || f.ends(&[".obj", ".stl", ".off", ".gltf"]) },
    ForeignKind { what: "a trajectory or a list", remedy: "give the folder of the sequence, and a trajectory in it with --poses FILE",
        is_one: |f| f.ends(&[".txt", ".csv", ".log", ".tum"]) },
];

/// The kind of a file; `None` if it is in no way known.
pub(super) fn kind_of(path: &Path) -> Option<&'static ForeignKind> {
    let mut bytes = Vec::new();
    let is_file = std::fs::metadata(path).is_ok_and(|metadata| metadata.is_file());
    if !is_file {
        return None;
    }
    let file = File::open(path).ok()?;
    file.take(HEAD).read_to_end(&mut bytes).ok()?;
    let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
    let start = Start {
        bytes: &bytes,
        name: &name,
    };
    KINDS.iter().find(|kind| (kind.is_one)(&start))
}

impl ForeignKind {
    /// Whether a sequence can come of such a file: a video, a recording, or a model of another program.
    pub(super) fn is_source(&self) -> bool {
        ![
            "a single image",
            "a mesh or a cloud",
            "a trajectory or a list",
        ]
        .contains(&self.what)
    }

    /// How to bring in a file of this kind.
    pub(super) fn remedy_for(&self, path: &Path) -> String {
        self.remedy.replace("{path}", &path.display().to_string())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(start: &[u8], text: &str) -> Vec<u8> {
        [start, text.as_bytes()].concat()
    }

    /// A file of each kind, by its place in the table.
    fn samples() -> Vec<(&'static str, Vec<u8>)> {
        let transport: Vec<u8> = (0..600)
            .map(|at| if at % 188 == 0 { 0x47 } else { 0 })
            .collect();
        let ebml = [0x1A, 0x45, 0xDF, 0xA3];
        vec![
            ("a.webm", with(&ebml, "....webm")),
            ("a.mkv", with(&ebml, "....matroska")),
            ("a.avi", b"RIFF\0\0\0\0AVI LIST".to_vec()),
            ("a.ts", transport),
            ("a.mpg", vec![0, 0, 1, 0xBA, 0]),
            ("a.flv", b"FLV\x01\x05".to_vec()),
            (
                "a.wmv",
                vec![0x30, 0x26, 0xB2, 0x75, 0x8E, 0x66, 0xCF, 0x11, 0],
            ),
            ("a.ogv", b"OggS\0".to_vec()),
            ("a.h264", vec![0, 0, 0, 1, 0x67]),
            ("a.gif", b"GIF89a".to_vec()),
            ("a.bag", b"#ROSBAG V2.0\n".to_vec()),
            ("a.mcap", b"\x89MCAP0\r\n".to_vec()),
            ("a.klg", vec![3, 0, 0, 0, 0]),
            ("a.db3", b"SQLite format 3\0".to_vec()),
            ("database.db", b"SQLite format 3\0".to_vec()),
            (
                "reconstruction.json",
                b"[{\"cameras\": {\"c\": {\"projection_type\": \"perspective\"}}}]".to_vec(),
            ),
            ("sfm_data.json", b"{\"sfm_data_version\": \"0.3\"}".to_vec()),
            (
                "cameras.sfm",
                b"{\"version\": [], \"views\": [], \"poses\": []}".to_vec(),
            ),
            ("bundle.out", b"# Bundle file v0.3\n1 0\n".to_vec()),
            (
                "cameras.xml",
                b"<?xml version=\"1.0\"?><document><chunk/></document>".to_vec(),
            ),
            ("a.zip", b"PK\x03\x04".to_vec()),
            ("a.tar.gz", vec![0x1F, 0x8B, 8]),
            ("a.png", b"\x89PNG\r\n".to_vec()),
            ("a.ply", b"ply\nformat ascii 1.0\n".to_vec()),
            ("poses.txt", b"0 1 2 3 0 0 0 1\n".to_vec()),
        ]
    }

    #[test]
    fn each_kind_is_told_by_its_own_message() {
        let folder = tempfile::tempdir().unwrap();
        let samples = samples();
        assert_eq!(samples.len(), KINDS.len());
        for ((name, bytes), kind) in samples.iter().zip(&KINDS) {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            let found = kind_of(&path).unwrap();
            assert_eq!(found.what, kind.what, "{name}");
            assert!(!found.remedy_for(&path).contains("{path}"), "{name}");
        }
        let unknown = folder.path().join("odd");
        std::fs::write(&unknown, [1, 2, 3]).unwrap();
        assert!(kind_of(&unknown).is_none());
        assert!(kind_of(folder.path()).is_none());
    }
}
