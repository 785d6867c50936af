//! An evaluation as text.

use std::fmt::Write;

use linecarve_mesh::evaluate::{DistanceStatistics, Evaluation, ShapeSummary};

pub(crate) fn evaluation_text(evaluation: &Evaluation) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    let _ = describe(evaluation, &mut text);
    text
}

fn describe(evaluation: &Evaluation, out: &mut String) -> std::fmt::Result {
    writeln!(out, "shape         {}", shape_in_words(&evaluation.shape))?;
    writeln!(
        out,
        "ground truth  {}",
        shape_in_words(&evaluation.ground_truth)
    )?;
    let alignment = &evaluation.alignment;
    write!(
        out,
        "alignment     {}, scale {:.6}",
        alignment.method, alignment.scale
    )?;
    if let (Some(pairs), Some(rms)) = (alignment.pairs, alignment.rms) {
        write!(
            out,
            ", rms {rms:.5} of {pairs} pairs drawn apart from the scored points"
        )?;
    }
    writeln!(out)?;
    match evaluation.region {
        Some([low, high]) => writeln!(
            out,
            "region        {} to {}; {} of {} points outside",
            point(low),
            point(high),
            evaluation.outside_region,
            evaluation.drawn
        )?,
        None => writeln!(out, "region        everywhere")?,
    }
    if let Some(observed) = evaluation.observed {
        writeln!(
            out,
            "observed      {:.1} % by {} keyframes; the rest does not count",
            100.0 * observed.share,
            observed.keyframes
        )?;
    }
    writeln!(out)?;
    writeln!(
        out,
        "distance           mean    median       rms      90 %      95 %   largest    points"
    )?;
    let ends = if evaluation.shape.kind == "lines" {
        "end points"
    } else {
        "vertices"
    };
    for (name, statistics) in [
        ("accuracy", &evaluation.accuracy),
        ("completeness", &evaluation.completeness),
        (ends, &evaluation.vertices),
    ] {
        write_statistics(name, statistics.as_ref(), out)?;
    }
    writeln!(out)?;
    writeln!(
        out,
        "threshold     precision    recall         F   of {ends}"
    )?;
    for at in &evaluation.at {
        let share =
            |value: Option<f64>| value.map_or("        -".to_owned(), |v| format!("{v:9.4}"));
        writeln!(
            out,
            "{:<12}  {} {} {}  {}",
            at.threshold,
            share(Some(at.precision)),
            share(at.recall),
            share(at.f),
            share(Some(at.vertex_precision))
        )?;
    }
    Ok(())
}

fn write_statistics(
    name: &str,
    statistics: Option<&DistanceStatistics>,
    out: &mut String,
) -> std::fmt::Result {
    match statistics {
        Some(s) => writeln!(
            out,
            "{name:<12}  {:9.5} {:9.5} {:9.5} {:9.5} {:9.5} {:9.5} {:9}",
            s.mean, s.median, s.rms, s.p90, s.p95, s.max, s.count
        ),
        None => writeln!(out, "{name:<12}          -"),
    }
}

fn shape_in_words(facts: &ShapeSummary) -> String {
    let mut text = format!("{}, {} vertices", facts.kind, facts.vertices);
    if facts.triangles > 0 {
        let _ = write!(text, ", {} triangles", facts.triangles);
    }
    if facts.lines > 0 {
        let _ = write!(text, ", {} lines", facts.lines);
    }
    let _ = write!(text, ", {:.4} from corner to corner", facts.diagonal);
    text
}

fn point([x, y, z]: [f64; 3]) -> String {
    format!("({x:.3}, {y:.3}, {z:.3})")
}
