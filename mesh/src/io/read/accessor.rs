//! The numbers behind a glTF accessor. Files may state wrong lengths, so every access is checked; the crate's own reader panics on some.

use gltf::json::accessor::{Accessor, ComponentType, Type};
use gltf::json::buffer::Stride;
use gltf::json::validation::{Checked, USize64};

use super::gltf::Data;

/// Maximum elements of an accessor without bytes of its own, per byte of the file's buffers.
const MAX_EXPANSION: usize = 64;

/// Components of all elements of an accessor, one element after the other. Normalised integers become 0 to 1, or -1 to 1.
pub(super) fn components(accessor: &Accessor, data: &Data<'_>) -> Result<Vec<f64>, String> {
    let (Checked::Valid(kind), Checked::Valid(component)) =
        (&accessor.type_, &accessor.component_type)
    else {
        return Err("an accessor of unknown type".to_owned());
    };
    let (width, component) = (width(*kind)?, component.0);
    let size = width * component.size();
    let count = whole(accessor.count)?;
    let total = count
        .checked_mul(width)
        .ok_or("an accessor of impossible size")?;
    let mut values = match accessor.buffer_view {
        Some(view) => {
            let view = data.view(view);
            let elements = Elements {
                bytes: data.bytes(view)?,
                start: whole(accessor.byte_offset.unwrap_or_default())?,
                stride: view.byte_stride.map_or(size, |Stride(stride)| stride),
                kind: component,
                width,
                is_normalized: accessor.normalized,
            };
            elements.read(count)?
        }
        // An accessor without a view is zero where its sparse part does not replace it.
        None => {
            if count > data.total_bytes().saturating_mul(MAX_EXPANSION) {
                return Err(format!("an accessor of {count} elements without data"));
            }
            vec![0.0; total]
        }
    };
    if let Some(sparse) = &accessor.sparse {
        let Checked::Valid(index) = &sparse.indices.component_type else {
            return Err("sparse indices of unknown type".to_owned());
        };
        let replaced = whole(sparse.count)?;
        let indices = Elements {
            bytes: data.bytes(data.view(sparse.indices.buffer_view))?,
            start: whole(sparse.indices.byte_offset)?,
            stride: index.0.size(),
            kind: index.0,
            width: 1,
            is_normalized: false,
        }
        .read(replaced)?;
        let replacements = Elements {
            bytes: data.bytes(data.view(sparse.values.buffer_view))?,
            start: whole(sparse.values.byte_offset)?,
            stride: size,
            kind: component,
            width,
            is_normalized: accessor.normalized,
        }
        .read(replaced)?;
        for (index, replacement) in indices.iter().zip(replacements.chunks_exact(width)) {
            let start = *index as usize * width;
            values
                .get_mut(start..start + width)
                .ok_or("a sparse index beyond the elements of its accessor")?
                .copy_from_slice(replacement);
        }
    }
    Ok(values)
}

/// A number of bytes or elements of this machine.
fn whole(number: USize64) -> Result<usize, String> {
    usize::try_from(number.0).map_err(|_| "an accessor of impossible size".to_owned())
}

/// Components per element.
fn width(kind: Type) -> Result<usize, String> {
    match kind {
        Type::Scalar => Ok(1),
        Type::Vec2 => Ok(2),
        Type::Vec3 => Ok(3),
        Type::Vec4 => Ok(4),
        other => Err(format!("{other:?} where numbers or vectors are expected")),
    }
}

/// Equally spaced elements in bytes.
struct Elements<'a> {
    bytes: &'a [u8],
    start: usize,
    stride: usize,
    kind: ComponentType,
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
            (ComponentType::I8, &[a]) => (f64::from(a as i8), f64::from(i8::MAX)),
            (ComponentType::U8, &[a]) => (f64::from(a), f64::from(u8::MAX)),
            (ComponentType::I16, &[a, b]) => {
                (f64::from(i16::from_le_bytes([a, b])), f64::from(i16::MAX))
            }
            (ComponentType::U16, &[a, b]) => {
                (f64::from(u16::from_le_bytes([a, b])), f64::from(u16::MAX))
            }
            (ComponentType::U32, &[a, b, c, d]) => (
                f64::from(u32::from_le_bytes([a, b, c, d])),
                f64::from(u32::MAX),
            ),
            (ComponentType::F32, &[a, b, c, d]) => {
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
