//! Reading Wavefront OBJ.

use std::path::{Path, PathBuf};

use nalgebra::Point3;

use super::types::{GeometryFault, LineSet, TriangleMesh};

/// Why an OBJ file is refused.
#[derive(Debug, thiserror::Error)]
pub enum ReadObjError {
    /// The file cannot be read or parsed.
    #[error("cannot read {}: {source} (an OBJ file is expected)", path.display())]
    Load {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: tobj::LoadError,
    },
    /// A vertex is not a number or an index out of range.
    #[error("{}: {fault}", path.display())]
    Geometry {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        fault: GeometryFault,
    },
}

/// What an OBJ file holds. Groups and objects are joined, materials passed over.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ObjContent {
    /// Its faces; polygons are cut into fans.
    pub mesh: TriangleMesh,
    /// Its `l` elements.
    pub lines: LineSet,
}

/// Reads meshes and lines from an OBJ file.
///
/// # Errors
/// When the file cannot be read or parsed, or holds vertices that are not finite.
pub fn read_obj(path: &Path) -> Result<ObjContent, ReadObjError> {
    let options = tobj::LoadOptions {
        single_index: false,
        triangulate: false,
        ignore_points: true,
        ignore_lines: false,
    };
    let (models, _) = tobj::load_obj(path, &options).map_err(|source| ReadObjError::Load {
        path: path.to_owned(),
        source,
    })?;
    let mut content = ObjContent::default();
    for model in models {
        let shape = model.mesh;
        let first = content.mesh.positions.len() as u32;
        let points = shape
            .positions
            .chunks_exact(3)
            .map(|p| Point3::new(p[0], p[1], p[2]));
        content.mesh.positions.extend(points);
        let mut rest = shape.indices.as_slice();
        let mut arities = shape.face_arities.iter();
        while !rest.is_empty() {
            // Without a list of arities all elements are triangles.
            let arity = arities.next().map_or(3, |arity| *arity as usize);
            let (element, tail) = rest.split_at(arity.clamp(1, rest.len()));
            rest = tail;
            match element {
                [a, b] => content.lines.lines.push([first + a, first + b]),
                [a, fan @ ..] => {
                    for pair in fan.windows(2) {
                        let triangle = [first + a, first + pair[0], first + pair[1]];
                        content.mesh.triangles.push(triangle);
                    }
                }
                [] => {}
            }
        }
    }
    content.lines.points.clone_from(&content.mesh.positions);
    content
        .mesh
        .validate()
        .and_then(|()| content.lines.validate())
        .map_err(|fault| ReadObjError::Geometry {
            path: path.to_owned(),
            fault,
        })?;
    Ok(content)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{write_lines_obj, write_mesh_obj};

    fn read(text: &str) -> Result<ObjContent, ReadObjError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("given.obj");
        std::fs::write(&path, text).unwrap();
        read_obj(&path)
    }

    #[test]
    fn what_is_written_reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("own.obj");
        let mesh = TriangleMesh {
            positions: vec![
                Point3::new(0.0, 0.25, 0.0),
                Point3::new(1.0, 0.0, 0.5),
                Point3::new(0.0, 2.0, 0.0),
            ],
            triangles: vec![[0, 1, 2]],
            colors: None,
        };
        write_mesh_obj(&path, &mesh).unwrap();
        assert_eq!(read_obj(&path).unwrap().mesh, mesh);

        let lines = LineSet::from_segments([[Point3::origin(), Point3::new(0.0, 0.0, 1.0)]]);
        write_lines_obj(&path, &lines).unwrap();
        let content = read_obj(&path).unwrap();
        assert_eq!(content.lines, lines);
        assert!(content.mesh.is_empty());
    }

    #[test]
    fn polygons_become_fans() {
        let content = read("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\nf 1/1 2/2 3/3\n");
        let triangles = content.unwrap().mesh.triangles;
        assert_eq!(triangles.len(), 3);
    }

    #[test]
    fn broken_files_are_refused_by_name() {
        for text in [
            "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
            "v 0 0\n",
            "v 0 0 0\nf 1 2 9\n",
            "f\n",
            "v x y z\n",
        ] {
            match read(text) {
                Ok(content) => assert!(content.mesh.is_empty(), "{text:?}"),
                Err(error) => assert!(error.to_string().contains("given.obj"), "{error}"),
            }
        }
        assert!(read_obj(Path::new("nowhere.obj")).is_err());
    }
}
