//! The numbers behind a glTF accessor.
//!
//! Files may lie about lengths, so every step is checked; the iterators of the `gltf` library take some of it on trust.

use gltf::Accessor;
use gltf::accessor::{DataType, Dimensions, sparse::IndexType};

/// Components of all elements of an accessor, as many an element as its kind has. Normalised integers become 0 to 1, or
/// -1 to 1.
pub(super) fn components(accessor: &Accessor<'_>, buffers: &[Vec<u8>]) -> Result<Vec<f64>, String> {
    let width = width(accessor.dimensions())?;
    let count = accessor.count();
    let total = count
        .checked_mul(width)
        .ok_or("an accessor of impossible size")?;
    let mut values = match accessor.view() {
        Some(view) => {
            let stride = view.stride();
            let bytes = view_bytes(&view, buffers)?;
            let reader = Elements {
                bytes,
                start: accessor.offset(),
                stride: stride.unwrap_or(accessor.size()),
                kind: accessor.data_type(),
                width,
                is_normalized: accessor.normalized(),
            };
            reader.read(count)?
        }
        // Without bytes of its own it is zeros, which only a sparse part makes useful.
        None if accessor.sparse().is_some() => {
            let largest: usize = buffers.iter().map(Vec::len).sum();
            if count > largest.saturating_mul(64) {
                return Err(format!("an accessor of {count} elements without data"));
            }
            vec![0.0; total]
        }
        None => return Err("an accessor without data".to_owned()),
    };
    if let Some(sparse) = accessor.sparse() {
        let indices = sparse.indices();
        let places = Elements {
            bytes: view_bytes(&indices.view(), buffers)?,
            start: indices.offset(),
            stride: indices.index_type().size(),
            kind: match indices.index_type() {
                IndexType::U8 => DataType::U8,
                IndexType::U16 => DataType::U16,
                IndexType::U32 => DataType::U32,
            },
            width: 1,
            is_normalized: false,
        }
        .read(sparse.count())?;
        let replacements = Elements {
            bytes: view_bytes(&sparse.values().view(), buffers)?,
            start: sparse.values().offset(),
            stride: accessor.size(),
            kind: accessor.data_type(),
            width,
            is_normalized: accessor.normalized(),
        }
        .read(sparse.count())?;
        for (place, replacement) in places.iter().zip(replacements.chunks_exact(width)) {
            let start = *place as usize * width;
            values
                .get_mut(start..start + width)
                .ok_or("a sparse accessor that replaces what is not there")?
                .copy_from_slice(replacement);
        }
    }
    Ok(values)
}

fn width(dimensions: Dimensions) -> Result<usize, String> {
    match dimensions {
        Dimensions::Scalar => Ok(1),
        Dimensions::Vec2 => Ok(2),
        Dimensions::Vec3 => Ok(3),
        Dimensions::Vec4 => Ok(4),
        other => Err(format!("{other:?} where numbers or vectors are expected")),
    }
}

fn view_bytes<'a>(
    view: &gltf::buffer::View<'_>,
    buffers: &'a [Vec<u8>],
) -> Result<&'a [u8], String> {
    let index = view.buffer().index();
    let end = view.offset().checked_add(view.length());
    buffers
        .get(index)
        .zip(end)
        .and_then(|(buffer, end)| buffer.get(view.offset()..end))
        .ok_or_else(|| {
            format!(
                "bytes {}..+{} of buffer {index} are not there: the file is cut short or damaged",
                view.offset(),
                view.length()
            )
        })
}

/// Equally spaced elements in bytes.
struct Elements<'a> {
    bytes: &'a [u8],
    start: usize,
    stride: usize,
    kind: DataType,
    width: usize,
    is_normalized: bool,
}

impl Elements<'_> {
    fn read(&self, count: usize) -> Result<Vec<f64>, String> {
        let component = self.kind.size();
        let element = component * self.width;
        if count == 0 {
            return Ok(Vec::new());
        }
        let end = self
            .stride
            .checked_mul(count - 1)
            .and_then(|offset| offset.checked_add(self.start))
            .and_then(|offset| offset.checked_add(element));
        if self.stride < element || end.is_none_or(|end| end > self.bytes.len()) {
            return Err(format!(
                "{count} elements of {element} bytes do not fit into a view of {} bytes",
                self.bytes.len()
            ));
        }
        let mut values = Vec::with_capacity(count * self.width);
        for index in 0..count {
            let start = self.start + index * self.stride;
            for bytes in self.bytes[start..start + element].chunks_exact(component) {
                values.push(self.value(bytes));
            }
        }
        Ok(values)
    }

    fn value(&self, bytes: &[u8]) -> f64 {
        let (value, largest) = match (self.kind, bytes) {
            (DataType::I8, &[a]) => (f64::from(a as i8), f64::from(i8::MAX)),
            (DataType::U8, &[a]) => (f64::from(a), f64::from(u8::MAX)),
            (DataType::I16, &[a, b]) => {
                (f64::from(i16::from_le_bytes([a, b])), f64::from(i16::MAX))
            }
            (DataType::U16, &[a, b]) => {
                (f64::from(u16::from_le_bytes([a, b])), f64::from(u16::MAX))
            }
            (DataType::U32, &[a, b, c, d]) => (
                f64::from(u32::from_le_bytes([a, b, c, d])),
                f64::from(u32::MAX),
            ),
            (DataType::F32, &[a, b, c, d]) => {
                return f64::from(f32::from_le_bytes([a, b, c, d]));
            }
            _ => unreachable!("chunks are as long as the kind is wide"),
        };
        if self.is_normalized {
            (value / largest).max(-1.0)
        } else {
            value
        }
    }
}
