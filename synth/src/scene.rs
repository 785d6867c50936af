//! Scenes: rectangles, lamps and a camera path.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::options::SceneKind;
use super::surface::Surface;
use super::texture::Texture;
use super::trajectory::{Motion, Path};
use linecarve_mesh::TriangleMesh;
use linecarve_mesh::srgb::encoded_color;

/// A scene of textured rectangles that face free space. Metres, z up.
#[derive(Debug, Clone)]
pub struct Scene {
    pub(super) surfaces: Vec<Surface>,
    pub(super) lamps: Vec<Lamp>,
    /// Ambient light without occlusion.
    pub(super) ambient: [f64; 3],
    pub(super) path: Path,
    /// Title for people.
    pub(super) title: &'static str,
}

/// A rectangular light along its normal, u cross v. It is not visible itself.
#[derive(Debug, Clone)]
pub(super) struct Lamp {
    pub(super) centre: Point3<f64>,
    pub(super) half_u: Vector3<f64>,
    pub(super) half_v: Vector3<f64>,
    /// Irradiance at one metre on its axis, by channel.
    pub(super) power: [f64; 3],
}

impl Scene {
    /// Builds the scene of a kind.
    pub fn new(kind: SceneKind) -> Self {
        match kind {
            SceneKind::Room => Self::room(),
            SceneKind::BareRoom => Self::bare_room(),
            SceneKind::Boxes => Self::boxes(),
            SceneKind::Corner => Self::corner(),
            SceneKind::Walk => Self::walk(),
        }
    }

    pub(super) fn empty(title: &'static str, path: Path) -> Self {
        Self {
            surfaces: Vec::new(),
            lamps: Vec::new(),
            ambient: [0.3; 3],
            path,
            title,
        }
    }

    /// The surface: two triangles per rectangle, counter-clockwise from the front, with the colour of each
    /// corner.
    pub fn mesh(&self) -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        let mut colors = Vec::new();
        for surface in &self.surfaces {
            let first = mesh.positions.len() as u32;
            let (width, height) = surface.size;
            for (u, v) in [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)] {
                mesh.positions.push(surface.point(u, v));
                let (color, _) = surface.color_at(u, v);
                colors.push(encoded_color(color));
            }
            mesh.triangles.push([first, first + 1, first + 2]);
            mesh.triangles.push([first, first + 2, first + 3]);
        }
        mesh.colors = Some(colors);
        mesh
    }

    /// Camera poses `world_from_camera` of `frames` frames along the path of the scene.
    pub fn poses(&self, frames: u32, seed: u64) -> Vec<Isometry3<f64>> {
        let motion = self.motion(frames, seed);
        (0..frames)
            .map(|frame| motion.at(f64::from(frame)))
            .collect()
    }

    pub(super) fn motion(&self, frames: u32, seed: u64) -> Motion {
        self.path.motion(frames, seed)
    }

    /// Adds a rectangle with edges `right` and `up`; see [`Surface::new`].
    pub(super) fn rectangle(
        &mut self,
        origin: [f64; 3],
        right: [f64; 3],
        up: [f64; 3],
        texture: Texture,
    ) {
        self.surfaces.push(Surface::new(
            Point3::from(origin),
            Vector3::from(right),
            Vector3::from(up),
            texture,
        ));
    }

    /// Adds a box.
    pub(super) fn cuboid(&mut self, pose: &Isometry3<f64>, size: [f64; 3], textures: &BoxTextures) {
        let [x, y, z] = [
            Vector3::x() * size[0],
            Vector3::y() * size[1],
            Vector3::z() * size[2],
        ];
        let low = -0.5 * (x + y);
        // (face, lower left corner from outside, right, up)
        let faces = [
            (Face::East, low + x, y, z),
            (Face::West, low + y, -y, z),
            (Face::North, low + x + y, -x, z),
            (Face::South, low, x, z),
            (Face::Top, low + z, x, y),
            (Face::Bottom, low + y, x, -y),
        ];
        for (face, corner, right, up) in faces {
            if textures.without.contains(&face) {
                continue;
            }
            let special = textures.faces.iter().find(|(f, _)| *f == face);
            let texture = special.map_or(&textures.texture, |(_, texture)| texture);
            self.surfaces.push(Surface::new(
                pose * Point3::from(corner),
                pose * right,
                pose * up,
                texture.clone(),
            ));
        }
    }

    /// Adds an upright box by the corners of its extent.
    pub(super) fn block(&mut self, low: [f64; 3], high: [f64; 3], textures: &BoxTextures) {
        let size = std::array::from_fn(|axis| high[axis] - low[axis]);
        let middle = |axis: usize| 0.5 * (low[axis] + high[axis]);
        self.cuboid(&at(middle(0), middle(1), low[2], 0.0), size, textures);
    }
}

/// A pose on a horizontal plane: the centre of a box's bottom, rotated by `yaw_rad`.
pub(super) fn at(x: f64, y: f64, z: f64, yaw_rad: f64) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(x, y, z),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad),
    )
}

/// Sides of a box in its own frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Face {
    East,
    West,
    North,
    South,
    Top,
    Bottom,
}

/// Textures of the sides of a box.
#[derive(Debug, Clone)]
pub(super) struct BoxTextures {
    texture: Texture,
    faces: Vec<(Face, Texture)>,
    without: Vec<Face>,
}

impl BoxTextures {
    /// The same texture on all sides except the bottom, on which boxes stand.
    pub(super) fn standing(texture: Texture) -> Self {
        Self {
            texture,
            faces: Vec::new(),
            without: vec![Face::Bottom],
        }
    }

    /// The same texture on all six sides.
    pub(super) fn all_sides(texture: Texture) -> Self {
        Self {
            without: Vec::new(),
            ..Self::standing(texture)
        }
    }

    /// Replaces the texture of one side.
    pub(super) fn with(mut self, face: Face, texture: Texture) -> Self {
        self.faces.push((face, texture));
        self
    }

    /// Leaves out a side that touches another surface.
    pub(super) fn without(mut self, face: Face) -> Self {
        self.without.push(face);
        self
    }
}
