//! The dense cloud of COLMAP read point by point, for clouds larger than memory.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use linecarve_mesh::files::open_regular;
use nalgebra::{Point3, Vector3};

use super::super::super::SequenceError;
use super::super::super::layout::Folder;
use super::facing::{FacingViews, read_cameras};
use super::{FoundModel, find_model, fused, read_images_only};
use crate::sparse_model::{ModelObservation, ModelPoint, ModelView};

/// A cloud of which only the views are in memory: `fused.ply` with `fused.ply.vis`, or any PLY file with normals and a list of cameras.
///
/// Views and points of `fused.ply` are those of [`Sequence::sparse_model`](crate::Sequence::sparse_model) of the same file.
#[derive(Debug)]
pub struct DenseCloud {
    cloud: PathBuf,
    views: Vec<ModelView>,
    rows: Rows,
    visibility: Visibility,
}

/// Numbers of points of a cloud that cannot be used.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SkippedPoints {
    /// Points with a coordinate that is not finite.
    pub not_finite: usize,
    /// Other points with a normal that is zero or not finite, where the normals decide on the views.
    pub without_normal: usize,
}

/// Where the views of points come from.
#[derive(Debug)]
enum Visibility {
    /// A file with the images of each point.
    File {
        path: PathBuf,
        /// View of each image, in the order of their ids.
        view_of_image: Vec<u32>,
    },
    /// The normals of the points, which are at these places of a row.
    Normals {
        places: [Place; 3],
        facing: FacingViews,
    },
}

/// Where in a row a number is, and whether it has 8 bytes.
type Place = (usize, bool);

/// The vertices of a binary, little-endian PLY file.
#[derive(Debug, Clone, Copy)]
struct Rows {
    start: u64,
    count: u64,
    bytes: usize,
    coordinates: [Place; 3],
    normals: Option<[Place; 3]>,
    /// Where in a row red, green and blue are; each has one byte.
    colors: Option<[usize; 3]>,
}

impl DenseCloud {
    /// Opens the cloud that a path names. `None` when the path names something else, or a PLY file that has to be read as a whole:
    /// text, big-endian, lists in vertices, other elements before these.
    ///
    /// # Errors
    /// When the model beside the cloud cannot be read.
    pub fn open(input: &Path) -> Result<Option<Self>, SequenceError> {
        let name = input.file_name().and_then(|name| name.to_str());
        let Some(name) = name.filter(|name| fused::is_cloud(name) && input.is_file()) else {
            return Ok(None);
        };
        let folder = Folder::of_file(input, name)?;
        let (Some(cloud), Some(FoundModel { path, format, .. })) =
            (fused::named_cloud(&folder), find_model(&folder))
        else {
            return Ok(None);
        };
        let Some(rows) = Rows::read(&cloud).map_err(io(&cloud))? else {
            return Ok(None);
        };
        let (mut model, view_of_image) = read_images_only(&path, format)?;
        let new_index = model.sort_images();
        Ok(Some(Self {
            visibility: Visibility::File {
                path: fused::visibility(&cloud),
                view_of_image: (view_of_image.iter())
                    .filter_map(|&view| new_index.get(view as usize).copied())
                    .collect(),
            },
            cloud,
            views: model.views(),
            rows,
        }))
    }

    /// Opens a PLY file with normals. A point is seen by the cameras on its normal's side in whose image it lies, at most twice as far
    /// away as the nearest; whether something hides it is not known. `cameras` is the folder of a model of COLMAP, or a text file with a
    /// line for each camera: `x y z qx qy qz qw width height fx fy cx cy`, world from camera.
    ///
    /// # Errors
    /// When a file cannot be read, or the cloud is no binary, little-endian PLY file with normals.
    pub fn with_cameras(cloud: &Path, cameras: &Path) -> Result<Self, SequenceError> {
        let rows = Rows::read(cloud).map_err(io(cloud))?;
        let normals = rows.and_then(|rows| Some((rows, rows.normals?)));
        let Some((rows, places)) = normals else {
            return Err(SequenceError::Content {
                path: cloud.to_owned(),
                problem: "is no PLY file of points with normals (x, y, z, nx, ny, nz), binary and little-endian: estimate normals, and \
                          save it so"
                    .to_owned(),
            });
        };
        let views = read_cameras(cameras)?;
        let facing = FacingViews::new(&views, cameras)?;
        Ok(Self {
            cloud: cloud.to_owned(),
            views,
            rows,
            visibility: Visibility::Normals { places, facing },
        })
    }

    /// The number of points, those that are not finite included.
    pub fn point_count(&self) -> u64 {
        self.rows.count
    }

    /// The file of the points.
    pub fn path(&self) -> &Path {
        &self.cloud
    }

    /// The views of the model.
    pub fn views(&self) -> &[ModelView] {
        &self.views
    }

    /// Passes the points to `take`, except for those that are not finite or have no usable normal; returns their numbers.
    ///
    /// # Errors
    /// When a file cannot be read, both differ in their number of points, or one names an unknown image; and what `take` returns.
    pub fn visit<E: From<SequenceError>>(
        &self,
        mut take: impl FnMut(ModelPoint) -> Result<(), E>,
    ) -> Result<SkippedPoints, E> {
        let mut skipped = SkippedPoints::default();
        let mut rows = open_regular(&self.cloud).map_err(io(&self.cloud))?;
        let start = SeekFrom::Start(self.rows.start);
        rows.seek(start).map_err(io(&self.cloud))?;
        let mut rows = BufReader::with_capacity(1 << 20, rows);
        let mut views = match &self.visibility {
            Visibility::File {
                path,
                view_of_image,
            } => ViewReader::File(VisibilityFile::open(path, view_of_image, self)?),
            Visibility::Normals { places, facing } => ViewReader::Normals(places, facing),
        };
        let mut row = vec![0; self.rows.bytes];
        for _ in 0..self.rows.count {
            rows.read_exact(&mut row).map_err(io(&self.cloud))?;
            let point_in_world = Point3::from(numbers(&row, &self.rows.coordinates));
            let is_finite = point_in_world.iter().all(|x| x.is_finite());
            let observations = match &mut views {
                // The lists of all points follow each other.
                ViewReader::File(file) => Some(file.next()?),
                ViewReader::Normals(places, facing) => {
                    let normal = Vector3::from(numbers(&row, places));
                    let is_usable = normal.iter().all(|x| x.is_finite()) && normal.amax() > 0.0;
                    is_usable.then(|| facing.of(&point_in_world, &normal))
                }
            };
            skipped.not_finite += usize::from(!is_finite);
            skipped.without_normal += usize::from(is_finite && observations.is_none());
            let Some(mut observations) = observations.filter(|_| is_finite) else {
                continue;
            };
            observations.sort_unstable_by_key(|observation| observation.view);
            observations.dedup_by_key(|observation| observation.view);
            take(ModelPoint {
                point_in_world,
                color: self.rows.colors.map(|at| at.map(|at| row[at])),
                observations,
            })?;
        }
        Ok(skipped)
    }
}

/// Has the views of one point after the other.
enum ViewReader<'a> {
    File(VisibilityFile<'a>),
    Normals(&'a [Place; 3], &'a FacingViews),
}

/// A file with the images of each point, read from its start.
struct VisibilityFile<'a> {
    path: &'a Path,
    view_of_image: &'a [u32],
    reader: BufReader<File>,
    at: u64,
}

impl<'a> VisibilityFile<'a> {
    fn open(
        path: &'a Path,
        view_of_image: &'a [u32],
        cloud: &DenseCloud,
    ) -> Result<Self, SequenceError> {
        fused::demand_visibility(&cloud.cloud)?;
        let file = open_regular(path).map_err(io(path))?;
        let mut file = Self {
            path,
            view_of_image,
            reader: BufReader::with_capacity(1 << 20, file),
            at: 0,
        };
        let count = u64::from_le_bytes(file.bytes()?);
        if count != cloud.rows.count {
            let problem = format!(
                "has {} points, {} has {count}: fuse both again",
                cloud.rows.count,
                path.display()
            );
            let path = cloud.cloud.clone();
            return Err(SequenceError::Content { path, problem });
        }
        Ok(file)
    }

    /// The views of the next point.
    fn next(&mut self) -> Result<Vec<ModelObservation>, SequenceError> {
        let count = self.u32()?;
        let mut observations = Vec::with_capacity(count.min(1 << 10) as usize);
        for _ in 0..count {
            let image = self.u32()?;
            let Some(&view) = self.view_of_image.get(image as usize) else {
                let views = self.view_of_image.len();
                return Err(self.error(format!(
                    "names image {image}, and the model has {views}: give the model that was fused"
                )));
            };
            observations.push(ModelObservation { view, pixel: None });
        }
        Ok(observations)
    }

    fn u32(&mut self) -> Result<u32, SequenceError> {
        self.bytes().map(u32::from_le_bytes)
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], SequenceError> {
        let mut bytes = [0; N];
        (self.reader.read_exact(&mut bytes)).map_err(|error| match error.kind() {
            std::io::ErrorKind::UnexpectedEof => {
                self.error("the file ends too early (truncated?): copy it again".to_owned())
            }
            _ => io(self.path)(error),
        })?;
        self.at += N as u64;
        Ok(bytes)
    }

    fn error(&self, problem: String) -> SequenceError {
        SequenceError::Byte {
            path: self.path.to_owned(),
            offset: self.at,
            problem,
        }
    }
}

fn io(path: &Path) -> impl Fn(std::io::Error) -> SequenceError + '_ {
    |error| SequenceError::Content {
        path: path.to_owned(),
        problem: error.to_string(),
    }
}

impl Rows {
    /// Reads the header; `None` when rows cannot be read one by one or the file is too short for them.
    fn read(path: &Path) -> std::io::Result<Option<Self>> {
        /// Longer headers are none of COLMAP.
        const LONGEST: u64 = 1 << 16;
        let file = open_regular(path)?;
        let length = file.metadata()?.len();
        let mut reader = BufReader::new(file.take(LONGEST));
        let mut start = 0;
        let mut lines = Vec::new();
        loop {
            let mut line = Vec::new();
            let read = reader.read_until(b'\n', &mut line)?;
            if read == 0 {
                return Ok(None);
            }
            start += read as u64;
            let line = String::from_utf8_lossy(&line).trim().to_owned();
            if line == "end_header" {
                break;
            }
            lines.push(line);
        }
        let rows = Self::parse(&lines, start);
        let is_whole = |rows: &Self| {
            let bytes = rows.count.checked_mul(rows.bytes as u64);
            bytes.is_some_and(|bytes| bytes <= length - rows.start)
        };
        Ok(rows.filter(is_whole))
    }

    fn parse(lines: &[String], start: u64) -> Option<Self> {
        let mut words = lines.iter().map(|line| {
            let words = line.split_ascii_whitespace();
            words.collect::<Vec<&str>>()
        });
        if words.next()? != ["ply"] {
            return None;
        }
        let mut elements = 0;
        let mut rows = Self {
            start,
            count: 0,
            bytes: 0,
            coordinates: [(0, false); 3],
            normals: None,
            colors: None,
        };
        let mut found: [Option<Place>; 6] = [None; 6];
        let mut colors = [None; 3];
        let mut names = BTreeSet::new();
        for words in words {
            match words[..] {
                ["format", format, _] if format != "binary_little_endian" => return None,
                ["element", name, count] => {
                    elements += 1;
                    if elements == 1 {
                        rows.count = count.parse().ok().filter(|_| name == "vertex")?;
                    }
                }
                // The reader of all PLY files names the property.
                ["property", _, name] if elements == 1 && !names.insert(name) => return None,
                ["property", kind, name] if elements == 1 => {
                    let size = match kind {
                        "char" | "uchar" | "int8" | "uint8" => 1,
                        "short" | "ushort" | "int16" | "uint16" => 2,
                        "int" | "uint" | "float" | "int32" | "uint32" | "float32" => 4,
                        "double" | "float64" => 8,
                        _ => return None,
                    };
                    let mut axes = ["x", "y", "z", "nx", "ny", "nz"].iter();
                    if let Some(k) = axes.position(|axis| *axis == name) {
                        let is_float = matches!(kind, "float" | "float32" | "double" | "float64");
                        if !is_float && k < 3 {
                            return None;
                        }
                        found[k] = is_float.then_some((rows.bytes, size == 8));
                    }
                    let mut channels = ["red", "green", "blue"].iter();
                    if let Some(k) = channels.position(|channel| *channel == name) {
                        colors[k] = matches!(kind, "uchar" | "uint8").then_some(rows.bytes);
                    }
                    rows.bytes += size;
                }
                ["property", ..] if elements == 1 => return None,
                _ => (),
            }
        }
        if let [Some(red), Some(green), Some(blue)] = colors {
            rows.colors = Some([red, green, blue]);
        }
        let [x, y, z, nx, ny, nz] = found;
        rows.coordinates = [x?, y?, z?];
        if let [Some(nx), Some(ny), Some(nz)] = [nx, ny, nz] {
            rows.normals = Some([nx, ny, nz]);
        }
        Some(rows)
    }
}

/// The numbers at these places of a row.
fn numbers(row: &[u8], places: &[Place; 3]) -> [f64; 3] {
    places.map(|(at, is_double)| {
        if is_double {
            let mut bytes = [0; 8];
            bytes.copy_from_slice(&row[at..at + 8]);
            return f64::from_le_bytes(bytes);
        }
        let mut bytes = [0; 4];
        bytes.copy_from_slice(&row[at..at + 4]);
        f64::from(f32::from_le_bytes(bytes))
    })
}
