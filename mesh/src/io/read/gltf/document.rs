//! The JSON document of a glTF file, with every index that geometry depends on checked.
//!
//! The crate's own check refuses files for faults in what is not read: animations, cameras, names of other attributes.

use gltf::json::accessor::Accessor;
use gltf::json::mesh::{Primitive, Semantic};
use gltf::json::validation::Checked;
use gltf::json::{Index, Node, Root, Scene, Value};
use gltf::scene::Transform;
use nalgebra::Matrix4;
use serde::Deserialize;

/// Extensions that a file may require without a change to its geometry.
const HARMLESS_EXTENSIONS: [&str; 1] = ["KHR_materials_unlit"];
const COMPRESSIONS: [&str; 3] = [
    "KHR_draco_mesh_compression",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
];

/// Parses the document and checks it.
pub(super) fn parse(json: &[u8]) -> Result<Root, String> {
    let root = Root::from_slice(json);
    let root = root.or_else(|error| with_nodes(json).ok_or_else(|| error.to_string()))?;
    check(&root)?;
    Ok(root)
}

/// A document in which scenes without nodes have an empty list of them, which the crate demands and the format does not.
fn with_nodes(json: &[u8]) -> Option<Root> {
    let mut document: Value = serde_json::from_slice(json).ok()?;
    for scene in document.get_mut("scenes")?.as_array_mut()? {
        let nodes = || Value::Array(Vec::new());
        scene.as_object_mut()?.entry("nodes").or_insert_with(nodes);
    }
    Root::from_slice(&serde_json::to_vec(&document).ok()?).ok()
}

/// The default scene, or the first one.
pub(super) fn default_scene(root: &Root) -> Option<&Scene> {
    root.scenes.get(root.scene.map_or(0, |scene| scene.value()))
}

/// The transform `parent_from_node` of a node, computed in single precision.
pub(super) fn parent_from_node(node: &Node) -> Matrix4<f32> {
    let transform = match node.matrix {
        Some([a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p]) => Transform::Matrix {
            matrix: [[a, b, c, d], [e, f, g, h], [i, j, k, l], [m, n, o, p]],
        },
        None => Transform::Decomposed {
            translation: node.translation.unwrap_or_default(),
            rotation: node.rotation.unwrap_or_default().0,
            scale: node.scale.unwrap_or([1.0; 3]),
        },
    };
    transform.matrix().into()
}

/// Checks extensions, every index that geometry depends on, and the bounds of positions.
fn check(root: &Root) -> Result<(), String> {
    for name in &root.extensions_required {
        if COMPRESSIONS.contains(&name.as_str()) {
            return Err(format!("it is compressed by {name}; store it uncompressed"));
        }
        if !HARMLESS_EXTENSIONS.contains(&name.as_str()) {
            return Err(format!(
                "it requires the extension {name}, which is not supported"
            ));
        }
    }
    for (index, view) in root.buffer_views.iter().enumerate() {
        let at = format!("bufferViews[{index}]");
        in_range(&at, "buffer", view.buffer, &root.buffers)?;
        if view.byte_stride.is_some_and(|s| !(4..=252).contains(&s.0)) {
            return Err(format!("{at}: the stride is not 4 to 252 bytes"));
        }
    }
    for (index, accessor) in root.accessors.iter().enumerate() {
        check_accessor(&format!("accessors[{index}]"), accessor, root)?;
    }
    for (index, mesh) in root.meshes.iter().enumerate() {
        for (number, primitive) in mesh.primitives.iter().enumerate() {
            let at = format!("meshes[{index}].primitives[{number}]");
            check_primitive(&at, primitive, root)?;
        }
    }
    for (index, node) in root.nodes.iter().enumerate() {
        let at = format!("nodes[{index}]");
        if let Some(mesh) = node.mesh {
            in_range(&at, "mesh", mesh, &root.meshes)?;
        }
        for child in node.children.iter().flatten() {
            in_range(&at, "node", *child, &root.nodes)?;
        }
    }
    for (index, scene) in root.scenes.iter().enumerate() {
        let at = format!("scenes[{index}]");
        for node in &scene.nodes {
            in_range(&at, "node", *node, &root.nodes)?;
        }
    }
    match root.scene {
        Some(scene) => in_range("the document", "scene", scene, &root.scenes),
        None => Ok(()),
    }
}

fn check_accessor(at: &str, accessor: &Accessor, root: &Root) -> Result<(), String> {
    let views = &root.buffer_views;
    for (is_known, what) in [
        (is_valid(&accessor.type_), "type"),
        (is_valid(&accessor.component_type), "component type"),
    ] {
        if !is_known {
            return Err(format!("{at}: its {what} is none of glTF"));
        }
    }
    if let Some(view) = accessor.buffer_view {
        in_range(at, "buffer view", view, views)?;
    }
    match &accessor.sparse {
        Some(sparse) => {
            in_range(at, "buffer view", sparse.indices.buffer_view, views)?;
            in_range(at, "buffer view", sparse.values.buffer_view, views)?;
            if !is_valid(&sparse.indices.component_type) {
                return Err(format!(
                    "{at}: its sparse indices are not unsigned integers"
                ));
            }
        }
        None if accessor.buffer_view.is_none() => {
            return Err(format!("{at}: it has no data"));
        }
        None => {}
    }
    Ok(())
}

fn check_primitive(at: &str, primitive: &Primitive, root: &Root) -> Result<(), String> {
    for accessor in primitive.attributes.values().chain(&primitive.indices) {
        in_range(at, "accessor", *accessor, &root.accessors)?;
    }
    if let Some(material) = primitive.material {
        in_range(at, "material", material, &root.materials)?;
    }
    if !is_valid(&primitive.mode) {
        return Err(format!("{at}: its mode is none of primitives"));
    }
    let positions = primitive
        .attributes
        .get(&Checked::Valid(Semantic::Positions));
    let Some(positions) = positions else {
        return Err(format!("{at}: it has no positions"));
    };
    let accessor = &root.accessors[positions.value()];
    let is_bound = |value: &Option<Value>| {
        let corner = value.as_ref().map(<[f32; 3]>::deserialize);
        matches!(corner, Some(Ok(_)))
    };
    if !is_bound(&accessor.min) || !is_bound(&accessor.max) {
        return Err(format!(
            "{at}: the accessor of its positions has no bounds min and max of 3 numbers each"
        ));
    }
    Ok(())
}

fn is_valid<T>(value: &Checked<T>) -> bool {
    matches!(value, Checked::Valid(_))
}

/// Refuses an index beyond the elements that exist.
fn in_range<T>(at: &str, element: &str, index: Index<T>, elements: &[T]) -> Result<(), String> {
    if index.value() < elements.len() {
        return Ok(());
    }
    Err(format!(
        "{at} refers to {element} {index}, but there are {}",
        elements.len()
    ))
}
