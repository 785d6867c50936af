//! Files of the images that messages bring.

use std::io::Write;
use std::path::PathBuf;

use base64::Engine;
use tempfile::TempDir;

use crate::stream::SessionError;
use crate::stream::message::ImageSource;

/// Removes unused files. Leftovers go with the temporary folder.
pub(super) fn delete(files: &[PathBuf]) {
    for path in files {
        let _ = std::fs::remove_file(path);
    }
}

/// The path of an image. Data in a message is written to a file, which is added to `stored_images`.
pub(super) fn store_image(
    folder: &TempDir,
    id: u64,
    source: &ImageSource,
    stored_images: &mut Vec<PathBuf>,
) -> Result<PathBuf, SessionError> {
    match source {
        ImageSource::Path(path) => Ok(path.clone()),
        ImageSource::Base64(text) => {
            let bytes = base64::engine::general_purpose::STANDARD
                .decode(text)
                .map_err(|source| SessionError::Base64 { id, source })?;
            let path = folder.path().join(format!("{id}-{}", stored_images.len()));
            stored_images.push(path.clone());
            std::fs::File::create(&path)
                .and_then(|mut file| file.write_all(&bytes))
                .map_err(|source| SessionError::Spool {
                    id,
                    folder: folder.path().to_owned(),
                    source,
                })?;
            Ok(path)
        }
    }
}
