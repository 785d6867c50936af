//! glTF 2.0, as text with buffers beside it or inside, and binary.
//!
//! Every mesh of the default scene, placed by its nodes, becomes part of one shape: triangles, strips and fans as
//! triangles, lines, strips and loops as lines, points as points. What [`write_glb`](crate::write_glb) says in
//! `extras.original_from_gltf` of the scene is undone.

use std::path::Path;

use base64::Engine;
use gltf::buffer::Source;
use gltf::mesh::Mode;
use nalgebra::{Matrix4, Point3};

use super::accessor::components;
use crate::shape::Shape;
use crate::srgb::encoded_color;

/// Nodes nest no deeper than this in files that are meant to be read.
const DEEPEST: usize = 256;

/// Length of the header of a binary file and of that of its first chunk.
const SMALLEST_BINARY: u32 = 12 + 8;

/// Refuses a binary file whose header says that it is shorter than the header: the library subtracts without looking.
fn check_length(bytes: &[u8]) -> Result<(), String> {
    let stated = bytes.starts_with(b"glTF").then(|| bytes.get(8..12));
    let Some(Some(Ok(stated))) = stated.map(|field| field.map(<[u8; 4]>::try_from)) else {
        return Ok(());
    };
    let stated = u32::from_le_bytes(stated);
    if stated < SMALLEST_BINARY {
        return Err(format!(
            "its header says that it is {stated} bytes long; a binary file has at least {SMALLEST_BINARY}"
        ));
    }
    Ok(())
}

/// Parses a file; buffers in files of their own are looked for beside `path`.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Shape, String> {
    check_length(bytes)?;
    let gltf::Gltf { document, blob } =
        gltf::Gltf::from_slice_without_validation(bytes).map_err(|error| error.to_string())?;
    let root = document.into_json();
    // The library's own validation looks at the bounds of positions before it knows that they are there.
    let accessors = root.accessors.len();
    let primitives = root.meshes.iter().flat_map(|mesh| &mesh.primitives);
    if primitives
        .flat_map(|primitive| primitive.attributes.values())
        .any(|index| index.value() >= accessors)
    {
        return Err(format!(
            "a mesh names an accessor beyond the {accessors} that are there"
        ));
    }
    let file = gltf::Document::from_json(root).map_err(|error| error.to_string())?;
    let compressions = [
        "KHR_draco_mesh_compression",
        "EXT_meshopt_compression",
        "KHR_meshopt_compression",
    ];
    if let Some(name) = file
        .extensions_required()
        .find(|name| compressions.contains(name))
    {
        return Err(format!("it is compressed by {name}; store it uncompressed"));
    }
    let buffers = load_buffers(&file, blob.as_deref(), path)?;
    let mut shape = Shape::default();
    let Some(scene) = file.default_scene().or_else(|| file.scenes().next()) else {
        // Without a scene there are still meshes, each where it was modelled.
        for mesh in file.meshes() {
            add_mesh(&mesh, &Matrix4::identity(), &buffers, &mut shape)?;
        }
        return Ok(shape);
    };
    let original_from_gltf = match scene.extras() {
        Some(extras) => original_from_gltf(extras.get())?,
        None => Matrix4::identity(),
    };
    let mut open: Vec<(gltf::Node<'_>, Matrix4<f64>, usize)> = scene
        .nodes()
        .map(|node| (node, original_from_gltf, 0))
        .collect();
    // The last is taken first: reversed, nodes come in the order of the file.
    open.reverse();
    while let Some((node, original_from_parent, depth)) = open.pop() {
        if depth > DEEPEST {
            return Err("its nodes contain themselves".to_owned());
        }
        let parent_from_node: Matrix4<f32> = node.transform().matrix().into();
        let original_from_node = original_from_parent * parent_from_node.cast::<f64>();
        if let Some(mesh) = node.mesh() {
            add_mesh(&mesh, &original_from_node, &buffers, &mut shape)?;
        }
        let first_child = open.len();
        open.extend(
            node.children()
                .map(|child| (child, original_from_node, depth + 1)),
        );
        open[first_child..].reverse();
    }
    Ok(shape)
}

/// The matrix in the extras of a scene; other extras mean nothing here.
fn original_from_gltf(extras: &str) -> Result<Matrix4<f64>, String> {
    #[derive(serde::Deserialize)]
    struct Extras {
        original_from_gltf: [[f64; 4]; 4],
    }
    let value: serde_json::Value = serde_json::from_str(extras).map_err(|e| e.to_string())?;
    if value.get("original_from_gltf").is_none() {
        return Ok(Matrix4::identity());
    }
    let Extras { original_from_gltf } = serde_json::from_value(value)
        .map_err(|_| "extras.original_from_gltf is not a matrix of 4 rows of 4".to_owned())?;
    let matrix = Matrix4::from_fn(|row, column| original_from_gltf[row][column]);
    if matrix.row(3) != Matrix4::identity().row(3) {
        return Err("the last row of extras.original_from_gltf is not 0 0 0 1".to_owned());
    }
    Ok(matrix)
}

fn load_buffers(
    file: &gltf::Document,
    blob: Option<&[u8]>,
    path: &Path,
) -> Result<Vec<Vec<u8>>, String> {
    let mut buffers = Vec::new();
    for buffer in file.buffers() {
        let bytes = match buffer.source() {
            Source::Bin => blob
                .ok_or("its binary part is missing: the file is cut short")?
                .to_vec(),
            Source::Uri(uri) => match uri.strip_prefix("data:") {
                Some(data) => {
                    let (_, text) = data
                        .split_once(";base64,")
                        .ok_or("a data URI that is not base64")?;
                    base64::engine::general_purpose::STANDARD
                        .decode(text)
                        .map_err(|error| format!("a damaged data URI: {error}"))?
                }
                None => {
                    let beside = path.with_file_name(unescaped(uri));
                    std::fs::read(&beside)
                        .map_err(|error| format!("its buffer {}: {error}", beside.display()))?
                }
            },
        };
        if bytes.len() < buffer.length() {
            return Err(format!(
                "buffer {} has {} of its {} bytes: the file is cut short",
                buffer.index(),
                bytes.len(),
                buffer.length()
            ));
        }
        buffers.push(bytes);
    }
    Ok(buffers)
}

/// A relative reference with its `%20` and the like resolved.
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
    mesh: &gltf::Mesh<'_>,
    original_from_mesh: &Matrix4<f64>,
    buffers: &[Vec<u8>],
    shape: &mut Shape,
) -> Result<(), String> {
    for primitive in mesh.primitives() {
        let part = read_primitive(&primitive, original_from_mesh, buffers).map_err(|message| {
            format!(
                "mesh {}, primitive {}: {message}",
                mesh.index(),
                primitive.index()
            )
        })?;
        if shape.positions.len() + part.positions.len() > u32::MAX as usize {
            return Err("more vertices than 32 bits can count".to_owned());
        }
        shape.append(part);
    }
    Ok(())
}

fn read_primitive(
    primitive: &gltf::Primitive<'_>,
    original_from_mesh: &Matrix4<f64>,
    buffers: &[Vec<u8>],
) -> Result<Shape, String> {
    let Some(accessor) = primitive.get(&gltf::Semantic::Positions) else {
        return Ok(Shape::default());
    };
    let coordinates = components(&accessor, buffers)?;
    if coordinates.len() != 3 * accessor.count() {
        return Err("positions are not vectors of three".to_owned());
    }
    let positions: Vec<Point3<f64>> = coordinates
        .chunks_exact(3)
        .map(|p| original_from_mesh.transform_point(&Point3::new(p[0], p[1], p[2])))
        .collect();
    let colors = match primitive.get(&gltf::Semantic::Colors(0)) {
        Some(accessor) => {
            let channels = components(&accessor, buffers)?;
            let width = channels.len() / accessor.count().max(1);
            (accessor.count() == positions.len() && width >= 3).then(|| {
                // Vertex colours of the format are linear.
                let linear = |c: &[f64]| encoded_color([c[0], c[1], c[2]]);
                channels.chunks_exact(width).map(linear).collect()
            })
        }
        None => None,
    };
    let order: Vec<u32> = match primitive.indices() {
        Some(accessor) => {
            let count = positions.len();
            let given = components(&accessor, buffers)?;
            if let Some(index) = given.iter().find(|index| **index >= count as f64) {
                return Err(format!("vertex {index} is named, there are {count}"));
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
    match primitive.mode() {
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
            // Every other triangle of a strip turns the other way.
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
    // A mirroring node turns its triangles inside out, which the format says is to be undone.
    if original_from_mesh.fixed_view::<3, 3>(0, 0).determinant() < 0.0 {
        for triangle in &mut part.triangles {
            triangle.swap(1, 2);
        }
    }
    Ok(part)
}
