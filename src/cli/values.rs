//! Words of the command line for choices of the libraries.

use clap::ValueEnum;
use linecarve_mesh::diff::Check;
use linecarve_mesh::texture::TextureFormat;
use linecarve_sequence::export::TrajectoryFormat;
use linecarve_synth::{SceneKind, SequenceLayout};

use crate::sinks::{Format, Growth};
use linecarve_engine::SourceChoice;
use linecarve_engine::options::LabelKind;
use linecarve_engine::tracking::TrackingMode;

/// Declares the command-line form of a library's enum: the same variants, with help texts and a conversion.
macro_rules! choice {
    ($(#[$about:meta])* $name:ident for $target:ty { $($(#[$help:meta])* $variant:ident,)+ }) => {
        $(#[$about])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
        pub enum $name { $($(#[$help])* $variant,)+ }

        impl From<$name> for $target {
            fn from(choice: $name) -> Self {
                match choice { $($name::$variant => Self::$variant,)+ }
            }
        }
    };
}

/// What a surface is made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SurfaceSource {
    /// 3D line segments on the image edges.
    Lines,
    /// Sparse points that several views see: those that the sequence brings along, or ORB features of its images. Needs no
    /// depth images.
    MapPoints,
}

impl SurfaceSource {
    /// The source with depth of lines from `depth`.
    pub fn with_depth(self, depth: DepthArg) -> SourceChoice {
        match self {
            Self::Lines => depth.into(),
            Self::MapPoints => SourceChoice::MapPoints,
        }
    }
}

choice! {
    /// Where depth comes from.
    DepthArg for SourceChoice {
        /// The sensor's when the sequence has depth images, else semi-dense.
        Auto,
        /// The sensor's.
        Sensor,
        /// Estimated at image edges from neighbouring keyframes.
        SemiDense,
    }
}

choice! {
    /// What poses are found from.
    TrackMode for TrackingMode {
        /// Colour and depth images.
        Rgbd,
        /// Left and right images.
        Stereo,
        /// Images of one camera.
        Mono,
    }
}

choice! {
    /// Formats of poses.
    TrackFormat for TrajectoryFormat {
        /// `stamp tx ty tz qx qy qz qw`, seconds: `poses.txt`, always written.
        Tum,
        /// `stamp,px,py,pz,qw,qx,qy,qz`, nanoseconds: `poses.csv`.
        Euroc,
        /// Twelve numbers a line: `poses-kitti.txt`.
        Kitti,
        /// `i i i+1` and a 4x4 matrix: `poses.log`.
        Open3dLog,
    }
}

choice! {
    /// How cells are labelled.
    LabelChoice for LabelKind {
        /// A cell is free when enough rays cross it, as in the literature on carving.
        Votes,
        /// Minimum cut with soft visibility, which weighs wrong points against right ones.
        Cut,
    }
}

choice! {
    /// File formats of meshes and lines.
    FormatChoice for Format {
        /// glTF 2.0, binary, +Y up.
        Glb,
        /// Wavefront OBJ in the frame of the poses.
        Obj,
        /// Binary PLY in the frame of the poses.
        Ply,
    }
}

choice! {
    /// What is written of the surface after each keyframe.
    GrowthChoice for Growth {
        /// The whole surface, as `keyframes/NNNNNN.glb`.
        Whole,
        /// What came and went, as `keyframes/NNNNNN.delta`: the size and cost of a file are those of the change. See
        /// docs/outputs.md.
        Delta,
    }
}

choice! {
    /// Format of a texture's image.
    TextureChoice for TextureFormat {
        /// Small, with a loss that can hardly be seen.
        Jpeg,
        /// Without loss, several times as large.
        Png,
    }
}

choice! {
    /// What `diff` compares.
    CheckChoice for Check {
        /// The largest distance between the surfaces, in both directions.
        Distance,
        /// The corners of the bounding boxes.
        Bounds,
        /// The largest distance from a vertex to the nearest vertex of the other mesh, when both have the same counts. It
        /// finds vertices that slide within their surface.
        Vertices,
        /// Triangles face the same side.
        Orientation,
        /// Numbers of components, boundary edges and loops, handles, non-manifold edges and edges of opposed orientation.
        Topology,
        /// Numbers of vertices and triangles.
        Counts,
    }
}

/// Scenes of `synth`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SceneChoice {
    /// A furnished room with a doorway to a corridor, seen all around.
    Room,
    /// The same room without its furniture.
    BareRoom,
    /// A table with a few boxes in empty space, seen from one side.
    Boxes,
    /// Three white walls that meet in a corner.
    Corner,
    /// Five furnished rooms in a row, seen on a walk through all of them and back; take 1000 frames or so.
    Walk,
    /// Points of a city with the views that see them, without images; see --points.
    City,
}

impl SceneChoice {
    /// The scene whose images are rendered; `None` for the city.
    pub fn rendered(self) -> Option<SceneKind> {
        match self {
            Self::Room => Some(SceneKind::Room),
            Self::BareRoom => Some(SceneKind::BareRoom),
            Self::Boxes => Some(SceneKind::Boxes),
            Self::Corner => Some(SceneKind::Corner),
            Self::Walk => Some(SceneKind::Walk),
            Self::City => None,
        }
    }
}

choice! {
    /// Folder layouts of `synth`.
    LayoutChoice for SequenceLayout {
        /// TUM RGB-D: rgb/, depth/ and lists with time stamps; 5000 depth units a metre.
        Tum,
        /// 7-Scenes: frame-NNNNNN.color, .depth, .pose; 1000 depth units a metre.
        #[value(name = "7-scenes")]
        SevenScenes,
        /// Open3D: image/, depth/ and trajectory.log; 1000 depth units a metre.
        #[value(name = "open3d")]
        Open3d,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_the_names_that_the_libraries_print() {
        let word = |value: Option<clap::builder::PossibleValue>| {
            value.map(|value| value.get_name().to_owned())
        };
        for choice in CheckChoice::value_variants() {
            assert_eq!(
                word(choice.to_possible_value()).as_deref(),
                Some(Check::from(*choice).name())
            );
        }
        for choice in SceneChoice::value_variants() {
            let Some(scene) = choice.rendered() else {
                continue;
            };
            assert_eq!(
                word(choice.to_possible_value()).as_deref(),
                Some(scene.name())
            );
        }
        for choice in LayoutChoice::value_variants() {
            assert_eq!(
                word(choice.to_possible_value()).as_deref(),
                Some(SequenceLayout::from(*choice).name())
            );
        }
    }
}
