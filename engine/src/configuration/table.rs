//! Declares a table of the configuration: its struct, its keys, and the options that they set.

use linecarve_mesh::diff::Tolerance;

use crate::options::{HoleFilling, LabelKind};

/// A table of the configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Table {
    /// Name in the file, such as `carving.cut`.
    pub name: &'static str,
    /// Description.
    pub doc: &'static str,
    /// Keys.
    pub keys: &'static [Key],
}

/// A key of the configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Key {
    /// Table and name, such as `carving.labels`.
    pub path: &'static str,
    /// Description.
    pub doc: &'static str,
    /// Accepted values.
    pub values: Values,
}

/// The values that a key accepts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Values {
    /// In words.
    pub text: &'static str,
    /// Least number.
    pub least: f64,
    /// Largest number.
    pub most: f64,
}

impl Values {
    /// Values that have no range.
    pub(super) const fn any(text: &'static str) -> Self {
        Self::range(f64::NEG_INFINITY, f64::INFINITY, text)
    }

    /// Numbers from `least` to `most`.
    pub(super) const fn range(least: f64, most: f64, text: &'static str) -> Self {
        Self { text, least, most }
    }
}

/// A value that is out of range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OutOfRange {
    pub(super) key: &'static Key,
    pub(super) value: f64,
}

/// A value of the configuration that sets a field of the options.
pub(super) trait Setting<Field> {
    fn from_field(field: &Field) -> Self;
    fn to_field(self) -> Field;
}

impl<T: Copy> Setting<T> for T {
    fn from_field(field: &T) -> T {
        *field
    }

    fn to_field(self) -> T {
        self
    }
}

/// A bound for which 0 stands for none.
impl Setting<Option<f64>> for f64 {
    fn from_field(field: &Option<f64>) -> f64 {
        field.unwrap_or(0.0)
    }

    fn to_field(self) -> Option<f64> {
        (self != 0.0).then_some(self)
    }
}

/// The number to be compared with a range, for values that have one.
pub(super) trait Number {
    fn number(&self) -> Option<f64> {
        None
    }
}

impl Number for f64 {
    fn number(&self) -> Option<f64> {
        Some(*self)
    }
}

impl Number for u32 {
    fn number(&self) -> Option<f64> {
        Some(f64::from(*self))
    }
}

impl Number for usize {
    fn number(&self) -> Option<f64> {
        Some(*self as f64)
    }
}

impl Number for Tolerance {
    fn number(&self) -> Option<f64> {
        Some(self.length(1.0))
    }
}

impl<T: Number> Number for Option<T> {
    fn number(&self) -> Option<f64> {
        self.as_ref().and_then(Number::number)
    }
}

impl Number for bool {}

impl Number for HoleFilling {}

impl Number for LabelKind {}

/// Declares a table: `["name"] Struct { key: Type = field of the options, values; ... } tables { name: Struct, ... }`.
macro_rules! table {
    (
        $(#[doc = $table_doc:literal])+
        [$table:literal] $Table:ident {
            $(
                $(#[doc = $doc:literal])+
                $(#[serde($($serde:tt)*)])?
                $key:ident: $Type:ty = $($field:ident).+ $(and $($same:ident).+)?, $values:expr;
            )*
        }
        tables { $( $(#[$meta:meta])+ $part:ident: $Part:ident, )* }
    ) => {
        $(#[doc = $table_doc])+
        #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $Table {
            $( $(#[doc = $doc])+ $(#[serde($($serde)*)])? pub $key: $Type, )*
            $( $(#[$meta])+ pub $part: $Part, )*
        }

        impl $Table {
            const KEYS: &'static [Key] = &[$(
                Key {
                    path: concat!($table, ".", stringify!($key)),
                    doc: concat!($($doc, "\n"),+),
                    values: $values,
                },
            )*];

            pub(super) fn describe(tables: &mut Vec<Table>) {
                tables.push(Table {
                    name: $table,
                    doc: concat!($($table_doc, "\n"),+),
                    keys: Self::KEYS,
                });
                $( $Part::describe(tables); )*
            }

            pub(super) fn from_options(options: &Options) -> Self {
                Self {
                    $( $key: Setting::from_field(&options.$($field).+), )*
                    $( $part: $Part::from_options(options), )*
                }
            }

            pub(super) fn set(&self, options: &mut Options) {
                $(
                    options.$($field).+ = Setting::to_field(self.$key);
                    $( options.$($same).+ = Setting::to_field(self.$key); )?
                )*
                $( self.$part.set(options); )*
            }

            pub(super) fn check(&self) -> Result<(), OutOfRange> {
                let numbers: &[Option<f64>] = &[$( self.$key.number() ),*];
                for (key, number) in Self::KEYS.iter().zip(numbers) {
                    // What is not a number is in no range.
                    if let Some(value) = *number
                        && !(value >= key.values.least && value <= key.values.most)
                    {
                        return Err(OutOfRange { key, value });
                    }
                }
                $( self.$part.check()?; )*
                Ok(())
            }
        }

        impl Default for $Table {
            fn default() -> Self {
                Self::from_options(&Options::default())
            }
        }
    };
}

pub(super) use table;
