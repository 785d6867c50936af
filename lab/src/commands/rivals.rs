//! Figures of other programs beside ours: meshes that are scored here, or figures quoted from a source.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use linecarve_mesh::{Shape, read_geometry};
use serde::Deserialize;

use super::results::ResultRow;
use super::scored_run::{f_scores, score};

/// A file of rivals.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct RivalsFile {
    #[serde(default)]
    rival: Vec<Rival>,
}

/// A rival on one sequence.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Rival {
    /// The sequence, as the table of results names it.
    pub(super) sequence: String,
    /// The program.
    name: String,
    /// Its mesh, which is scored like ours; relative to the file of rivals.
    mesh: Option<PathBuf>,
    /// Its time.
    seconds: Option<f64>,
    /// Its peak memory.
    peak_memory_mb: Option<f64>,
    /// Quoted F at 2, 5 and 10 cm, in place of a mesh; NaN where it is not known.
    f: Option<[f64; 3]>,
    /// Quoted vertices of its surface.
    vertices: Option<usize>,
    /// Quoted time of a keyframe; the source says what it covers.
    milliseconds_per_keyframe: Option<f64>,
    /// Origin of the quoted figures.
    source: Option<String>,
}

/// Reads a file of rivals.
pub(super) fn read(path: &Path) -> anyhow::Result<Vec<Rival>> {
    let text =
        std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let file: RivalsFile = toml::from_str(&text).with_context(|| path.display().to_string())?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut rivals = file.rival;
    for rival in &mut rivals {
        ensure!(
            rival.mesh.is_some() != rival.f.is_some(),
            "{}: {} on {}: give either mesh or f",
            path.display(),
            rival.name,
            rival.sequence
        );
        ensure!(
            rival.f.is_none() || rival.source.is_some(),
            "{}: {} on {}: quoted figures need their source",
            path.display(),
            rival.name,
            rival.sequence
        );
        rival.mesh = rival.mesh.take().map(|mesh| folder.join(mesh));
    }
    Ok(rivals)
}

/// Reads `NAME=MESH,SECONDS`.
pub(super) fn parse(text: &str, sequence: &str) -> anyhow::Result<Rival> {
    let parts = text
        .split_once('=')
        .and_then(|(name, rest)| Some((name, rest.rsplit_once(',')?)))
        .and_then(|(name, (mesh, seconds))| Some((name, mesh, seconds.trim().parse().ok()?)));
    let Some((name, mesh, seconds)) = parts else {
        bail!("--rival {text}: write it as NAME=MESH,SECONDS");
    };
    Ok(Rival {
        sequence: sequence.to_owned(),
        name: name.to_owned(),
        mesh: Some(mesh.into()),
        seconds: Some(seconds),
        peak_memory_mb: None,
        f: None,
        vertices: None,
        milliseconds_per_keyframe: None,
        source: None,
    })
}

impl Rival {
    /// Its row; a mesh is scored against `truth`.
    pub(super) fn row(&self, truth: &Shape) -> anyhow::Result<ResultRow> {
        let (mut f, mut vertices) = (self.f.unwrap_or([f64::NAN; 3]).to_vec(), self.vertices);
        if let Some(path) = &self.mesh {
            let mesh = read_geometry(path)?;
            let evaluation =
                score(&mesh, None, truth).with_context(|| path.display().to_string())?;
            f = f_scores(&evaluation);
            vertices = Some(mesh.positions.len());
        }
        Ok(ResultRow {
            sequence: self.sequence.clone(),
            method: self.name.clone(),
            keyframes: None,
            f,
            vertices,
            milliseconds_per_keyframe: self.milliseconds_per_keyframe,
            seconds: self.seconds,
            peak_memory_mb: self.peak_memory_mb,
            source: self.source.clone(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rival_has_a_name_a_mesh_and_a_time() {
        let rival = parse("TSDF fusion, 2 cm=out/a,b.ply,12.5", "room").unwrap();
        assert_eq!(rival.name, "TSDF fusion, 2 cm");
        assert_eq!(rival.mesh.as_deref(), Some(Path::new("out/a,b.ply")));
        assert_eq!(rival.seconds, Some(12.5));
        for bad in ["mesh.ply,3", "name=mesh.ply", "name=mesh.ply,soon"] {
            assert!(parse(bad, "room").is_err(), "{bad}");
        }
    }

    #[test]
    fn quoted_figures_need_a_source() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rivals.toml");
        let entry = "[[rival]]\nsequence = \"kitchen\"\nname = \"other\"\nf = [nan, 0.5, nan]\n";
        std::fs::write(&path, entry).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("source"));
        std::fs::write(&path, format!("{entry}source = \"a paper\"\n")).unwrap();
        assert_eq!(read(&path).unwrap().len(), 1);
    }

    #[test]
    fn the_rivals_in_the_repository_are_valid() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("rivals.toml");
        assert!(!read(&path).unwrap().is_empty());
    }
}
