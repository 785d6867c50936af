//! The models that COLMAP's mapper leaves in numbered folders: parts of one recording, each in coordinates of its own.

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use super::super::super::Warning;
use super::{ModelFormat, format_of};

/// A model of a numbered folder, and its number of images.
pub(super) struct NumberedModel {
    pub(super) path: PathBuf,
    pub(super) format: ModelFormat,
    images: u64,
}

/// The models of the numbered folders in `parent`, the one with the most images first, then by number.
pub(super) fn models_in(parent: &Path) -> Vec<NumberedModel> {
    let Ok(entries) = std::fs::read_dir(parent) else {
        return Vec::new();
    };
    let mut found: Vec<(u64, NumberedModel)> = entries
        .flatten()
        .filter_map(|entry| {
            let number = entry.file_name().to_str()?.parse().ok()?;
            let path = entry.path();
            let format = format_of(&path)?;
            let images = count_images(&path, format).unwrap_or(0);
            let model = NumberedModel {
                path,
                format,
                images,
            };
            Some((number, model))
        })
        .collect();
    found.sort_by_key(|(number, model)| (std::cmp::Reverse(model.images), *number));
    found.into_iter().map(|(_, model)| model).collect()
}

fn count_images(folder: &Path, format: ModelFormat) -> std::io::Result<u64> {
    let file = std::fs::File::open(folder.join(format!("images.{}", format.extension())))?;
    let mut file = BufReader::new(file);
    match format {
        ModelFormat::Binary => {
            let mut count = [0; 8];
            file.read_exact(&mut count)?;
            Ok(u64::from_le_bytes(count))
        }
        ModelFormat::Text => {
            // Two lines an image, of which the second may be empty.
            let (mut images, mut is_second) = (0, false);
            for line in file.lines() {
                let line = line?;
                let is_data = !line.trim().is_empty() && !line.starts_with('#');
                if is_second {
                    is_second = false;
                } else if is_data {
                    images += 1;
                    is_second = true;
                }
            }
            Ok(images)
        }
    }
}

/// Names the models that are not read.
pub(super) fn others_left_out(models: &[NumberedModel]) -> Option<Warning> {
    let (read, others) = models.split_first()?;
    let others: Vec<String> = others
        .iter()
        .map(|other| format!("{} with {}", other.path.display(), other.images))
        .collect();
    (!others.is_empty()).then(|| {
        Warning::statement(format!(
            "there are {} models: {} with {} images is read, the largest; not {} (--model N reads another)",
            others.len() + 1,
            read.path.display(),
            read.images,
            others.join(", ")
        ))
    })
}
