//! glTF 2.0, as text with buffers beside it or inside, and binary.
//!
//! Every mesh of the default scene, transformed by its nodes, becomes part of one shape: triangles, strips and fans as
//! triangles; lines, strips and loops as lines; points as points. The transform that
//! [`write_glb`](crate::write_glb) stores in `extras.original_from_gltf` of the scene is undone.

mod container;
mod document;
mod texture;

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use base64::Engine;
use gltf::json::accessor::Type;
use gltf::json::buffer::View;
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;
use gltf::json::{Accessor, Index, Mesh, Node, Root, Scene, extras::RawValue};
use nalgebra::{Matrix4, Point3};
use serde::Deserialize;

use super::accessor::components;
use crate::files::read_regular;
use crate::shape::Shape;
use crate::srgb::encoded_color;
use crate::texture::Texture;
use texture::Textures;

/// Most vertices and indices in all copies of meshes beyond the first: files of a few kilobytes could ask for any number.
const MAX_COPIED: usize = 1 << 26;

/// A document with the bytes of its buffers.
pub(super) struct Data<'a> {
    document: Root,
    buffers: Vec<Cow<'a, [u8]>>,
}

impl Data<'_> {
    /// Bytes of all buffers together.
    pub(super) fn total_bytes(&self) -> usize {
        self.buffers.iter().map(|buffer| buffer.len()).sum()
    }

    /// A buffer view, which the document has checked to exist.
    pub(super) fn view(&self, index: Index<View>) -> &View {
        &self.document.buffer_views[index.value()]
    }

    /// Bytes of a view.
    pub(super) fn bytes(&self, view: &View) -> Result<&[u8], String> {
        let start = view.byte_offset.map_or(0, |offset| offset.0);
        let end = start.checked_add(view.byte_length.0);
        let range = usize::try_from(start)
            .ok()
            .zip(end.and_then(|end| usize::try_from(end).ok()));
        range
            .and_then(|(start, end)| self.buffers[view.buffer.value()].get(start..end))
            .ok_or_else(|| {
                format!(
                    "bytes {start}..+{} of buffer {} are not there: the file is cut short or damaged",
                    view.byte_length.0, view.buffer
                )
            })
    }
}

/// Parses a file; buffers in files of their own are looked for beside `path`.
pub(super) fn parse(
    bytes: &[u8],
    path: &Path,
    is_textured: bool,
) -> Result<(Shape, Option<Texture>), String> {
    let (json, binary) = container::split(bytes)?;
    let document = document::parse(&json)?;
    let buffers = load_buffers(&document, binary.as_deref(), path)?;
    let data = Data { document, buffers };
    let document = &data.document;
    let mut shape = Shape::default();
    let mut textures = is_textured.then(Textures::default);
    let Some(scene) = document::default_scene(document) else {
        // Without a scene, every mesh is read in its own frame.
        for index in 0..document.meshes.len() as u32 {
            add_mesh(
                Index::new(index),
                &Matrix4::identity(),
                &data,
                &mut shape,
                &mut textures,
            )?;
        }
        let texture = textures.map(|all| all.load(&data, path)).transpose()?;
        return Ok((shape, texture.flatten()));
    };
    add_scene(scene, &data, &mut shape, &mut textures)?;
    let texture = textures.map(|all| all.load(&data, path)).transpose()?;
    Ok((shape, texture.flatten()))
}

/// Adds the meshes of all nodes of a scene, in the order of the file.
fn add_scene(
    scene: &Scene,
    data: &Data<'_>,
    shape: &mut Shape,
    textures: &mut Option<Textures>,
) -> Result<(), String> {
    let document = &data.document;
    let original_from_gltf = match &scene.extras {
        Some(extras) => original_from_gltf(extras)?,
        None => Matrix4::identity(),
    };
    let mut open = children(&scene.nodes, original_from_gltf);
    let mut is_reached = vec![false; document.nodes.len()];
    let mut is_used = vec![false; document.meshes.len()];
    let mut copied = 0;
    while let Some((index, original_from_parent)) = open.pop() {
        if std::mem::replace(&mut is_reached[index.value()], true) {
            return Err(format!(
                "node {index} has two parents or contains itself, which glTF forbids; export it with a copy of the node for each parent"
            ));
        }
        let node = &document.nodes[index.value()];
        let original_from_node =
            original_from_parent * document::parent_from_node(node).cast::<f64>();
        if let Some(mesh) = node.mesh {
            let before = size(shape);
            add_mesh(mesh, &original_from_node, data, shape, textures)?;
            if std::mem::replace(&mut is_used[mesh.value()], true) {
                copied += size(shape) - before;
            }
            if copied > MAX_COPIED {
                return Err(format!(
                    "its nodes copy meshes to more than {MAX_COPIED} vertices and indices; export it with fewer copies"
                ));
            }
        }
        let nodes = node.children.as_deref().unwrap_or_default();
        open.extend(children(nodes, original_from_node));
    }
    Ok(())
}

/// Nodes with the transform of their parent for a stack, which is emptied from its end: reversed, they come in the order of the file.
fn children(
    nodes: &[Index<Node>],
    original_from_parent: Matrix4<f64>,
) -> Vec<(Index<Node>, Matrix4<f64>)> {
    let nodes = nodes.iter().rev();
    nodes.map(|node| (*node, original_from_parent)).collect()
}

/// Vertices and indices of a shape.
fn size(shape: &Shape) -> usize {
    shape.positions.len() + 3 * shape.triangles.len() + 2 * shape.lines.len()
}

/// The matrix in the extras of a scene, or the identity when they have none.
fn original_from_gltf(extras: &RawValue) -> Result<Matrix4<f64>, String> {
    // What others store there may be anything.
    let extras: serde_json::Value = serde_json::from_str(extras.get()).unwrap_or_default();
    let Some(rows) = extras.get("original_from_gltf") else {
        return Ok(Matrix4::identity());
    };
    let rows = <[[f64; 4]; 4]>::deserialize(rows)
        .map_err(|_| "extras.original_from_gltf is not a matrix of 4 rows of 4".to_owned())?;
    let matrix = Matrix4::from_fn(|row, column| rows[row][column]);
    if matrix.row(3) != Matrix4::identity().row(3) {
        return Err("the last row of extras.original_from_gltf is not 0 0 0 1".to_owned());
    }
    Ok(matrix)
}

fn load_buffers<'a>(
    document: &Root,
    binary: Option<&'a [u8]>,
    path: &Path,
) -> Result<Vec<Cow<'a, [u8]>>, String> {
    let mut buffers = Vec::new();
    for (index, buffer) in document.buffers.iter().enumerate() {
        let bytes: Cow<'a, [u8]> = match &buffer.uri {
            None => binary
                .ok_or("its binary chunk is missing: the file is cut short")?
                .into(),
            Some(uri) => resource(uri, path, "buffer")?.into(),
        };
        if (bytes.len() as u64) < buffer.byte_length.0 {
            return Err(format!(
                "buffer {index} has {} of its {} bytes: the file is cut short",
                bytes.len(),
                buffer.byte_length.0
            ));
        }
        buffers.push(bytes);
    }
    Ok(buffers)
}

/// The bytes behind a reference: a data URI, or a file beside `path`.
fn resource(uri: &str, path: &Path, what: &str) -> Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (_, text) = data
            .split_once(";base64,")
            .ok_or("a data URI that is not base64")?;
        return base64::engine::general_purpose::STANDARD
            .decode(text)
            .map_err(|error| format!("a damaged data URI: {error}"));
    }
    let beside = path.with_file_name(unescaped(uri));
    read_regular(&beside).map_err(|error| format!("its {what} {}: {error}", beside.display()))
}

/// The file beside `path` that a reference names, unless it is a data URI.
fn beside(uri: &str, path: &Path) -> Option<PathBuf> {
    (!uri.starts_with("data:")).then(|| path.with_file_name(unescaped(uri)))
}

/// A relative reference with percent-encoding resolved.
fn unescaped(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, tail @ ..] = rest {
        rest = tail;
        let escaped = match (first, tail) {
            (b'%', [high, low, after @ ..]) => {
                let digit = |c: &u8| char::from(*c).to_digit(16);
                digit(high).zip(digit(low)).map(|(high, low)| {
                    rest = after;
                    (16 * high + low) as u8
                })
            }
            _ => None,
        };
        bytes.push(escaped.unwrap_or(*first));
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

fn add_mesh(
    index: Index<Mesh>,
    original_from_mesh: &Matrix4<f64>,
    data: &Data<'_>,
    shape: &mut Shape,
    textures: &mut Option<Textures>,
) -> Result<(), String> {
    let mesh = &data.document.meshes[index.value()];
    for (number, primitive) in mesh.primitives.iter().enumerate() {
        let part = read_primitive(primitive, original_from_mesh, data)
            .map_err(|message| format!("mesh {index}, primitive {number}: {message}"))?;
        if shape.positions.len() + part.positions.len() > u32::MAX as usize {
            return Err("more vertices than 32 bits can count".to_owned());
        }
        if let Some(textures) = textures {
            textures
                .add(primitive, &part.triangles, data)
                .map_err(|message| format!("mesh {index}, primitive {number}: {message}"))?;
        }
        shape.append(part);
    }
    Ok(())
}

fn read_primitive(
    primitive: &Primitive,
    original_from_mesh: &Matrix4<f64>,
    data: &Data<'_>,
) -> Result<Shape, String> {
    let accessor_at = |index: Index<Accessor>| &data.document.accessors[index.value()];
    let attribute = |semantic: Semantic| {
        let accessor = primitive.attributes.get(&Checked::Valid(semantic))?;
        Some(accessor_at(*accessor))
    };
    let Some(accessor) = attribute(Semantic::Positions) else {
        return Ok(Shape::default());
    };
    let coordinates = components(accessor, data)?;
    if accessor.type_ != Checked::Valid(Type::Vec3) {
        return Err("positions are not vectors of three".to_owned());
    }
    let positions: Vec<Point3<f64>> = coordinates
        .chunks_exact(3)
        .map(|p| original_from_mesh.transform_point(&Point3::new(p[0], p[1], p[2])))
        .collect();
    let colors = match attribute(Semantic::Colors(0)) {
        Some(accessor) => {
            let channels = components(accessor, data)?;
            let count = accessor.count.0 as usize;
            let width = channels.len() / count.max(1);
            (count == positions.len() && width >= 3).then(|| {
                // Vertex colours of the format are linear.
                let linear = |c: &[f64]| encoded_color([c[0], c[1], c[2]]);
                channels.chunks_exact(width).map(linear).collect()
            })
        }
        None => None,
    };
    let order: Vec<u32> = match primitive.indices {
        Some(accessor) => {
            let count = positions.len();
            let given = components(accessor_at(accessor), data)?;
            if let Some(index) = given.iter().find(|index| **index >= count as f64) {
                return Err(format!(
                    "it refers to vertex {index}, but there are {count}"
                ));
            }
            given.iter().map(|index| *index as u32).collect()
        }
        None => (0..positions.len() as u32).collect(),
    };
    let mut part = Shape {
        positions,
        colors,
        ..Shape::default()
    };
    let corners = order.as_slice();
    // The document has checked the mode.
    let mode = match primitive.mode {
        Checked::Valid(mode) => mode,
        Checked::Invalid => return Ok(part),
    };
    match mode {
        Mode::Points => {}
        Mode::Lines => part
            .lines
            .extend(corners.chunks_exact(2).map(|l| [l[0], l[1]])),
        Mode::LineStrip => part.lines.extend(corners.windows(2).map(|l| [l[0], l[1]])),
        Mode::LineLoop => {
            part.lines.extend(corners.windows(2).map(|l| [l[0], l[1]]));
            if let [first, _, .., last] = corners {
                part.lines.push([*last, *first]);
            }
        }
        Mode::Triangles => part
            .triangles
            .extend(corners.chunks_exact(3).map(|t| [t[0], t[1], t[2]])),
        Mode::TriangleStrip => {
            // Every other triangle of a strip has the opposite orientation.
            let turned = |(at, t): (usize, &[u32])| [t[0], t[1 + at % 2], t[2 - at % 2]];
            part.triangles
                .extend(corners.windows(3).enumerate().map(turned));
        }
        Mode::TriangleFan => {
            if let [first, fan @ ..] = corners {
                part.triangles
                    .extend(fan.windows(2).map(|t| [*first, t[0], t[1]]));
            }
        }
    }
    // The format reverses the orientation of triangles under a mirroring node; this restores it.
    if original_from_mesh.fixed_view::<3, 3>(0, 0).determinant() < 0.0 {
        for triangle in &mut part.triangles {
            triangle.swap(1, 2);
        }
    }
    Ok(part)
}
