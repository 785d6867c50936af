//! Whether places that were seen again contradict the path.

use linecarve_sequence::Sequence;
use linecarve_tracking::LoopReport;

/// Refused loops turn paths that merely drift by less than 6 degrees (recordings and rendered rooms, one camera), and torn maps by
/// more than 20.
const MAX_DRIFT_DEGREES: f64 = 15.0;

/// A warning, when the map has places elsewhere than the images do, and no later loop has corrected that.
pub(super) fn contradiction(loops: &[LoopReport], sequence: &Sequence) -> Option<String> {
    let refused = contradicting(loops);
    let worst = refused
        .iter()
        .max_by(|a, b| a.rotation_degrees.total_cmp(&b.rotation_degrees))?;
    let name = |frame: u32| &sequence.frames()[frame as usize].name;
    Some(format!(
        "the path is wrong somewhere between frames {} and {}: {} keyframes saw a place again that lies up to {:.0} degrees from where the \
         path has it. Look at the page, or track the parts before and after by themselves",
        name(worst.frame.min(worst.to_frame)),
        name(worst.frame.max(worst.to_frame)),
        refused.len(),
        worst.rotation_degrees,
    ))
}

/// Refused loops after the last one that was closed, beyond what drift explains.
fn contradicting(loops: &[LoopReport]) -> Vec<&LoopReport> {
    let closed = loops.iter().rposition(|one| one.is_closed);
    let later = &loops[closed.map_or(0, |at| at + 1)..];
    let is_beyond = |one: &&LoopReport| one.rotation_degrees > MAX_DRIFT_DEGREES;
    later.iter().filter(is_beyond).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(frame: u32, rotation_degrees: f64, is_closed: bool) -> LoopReport {
        LoopReport {
            frame,
            to_frame: 3,
            matches: 80,
            translation: 0.1,
            rotation_degrees,
            is_closed,
            joins_submaps: false,
        }
    }

    #[test]
    fn drift_and_what_was_corrected_are_no_contradiction() {
        assert!(contradicting(&[]).is_empty());
        assert!(contradicting(&[of(40, 5.4, false), of(41, 14.0, false)]).is_empty());
        assert!(contradicting(&[of(40, 25.0, false), of(41, 24.0, true)]).is_empty());
        let torn = [
            of(40, 2.0, true),
            of(50, 83.0, false),
            of(51, 4.0, false),
            of(52, 85.0, false),
        ];
        let found: Vec<u32> = contradicting(&torn).iter().map(|one| one.frame).collect();
        assert_eq!(found, [50, 52]);
    }

    #[test]
    fn the_warning_names_the_frames() {
        let folder = tempfile::tempdir().unwrap();
        let options = linecarve_synth::SynthOptions {
            scene: linecarve_synth::SceneKind::Corner,
            frames: 6,
            width: 32,
            height: 24,
            layout: linecarve_synth::SequenceLayout::SevenScenes,
            ..linecarve_synth::SynthOptions::default()
        };
        linecarve_synth::write_sequence(&options, folder.path(), &|_, _| {}).unwrap();
        let sequence = Sequence::open(folder.path(), &Default::default()).unwrap();
        let warning = contradiction(&[of(5, 85.2, false)], &sequence).unwrap();
        assert!(
            warning.contains("between frames frame-000003 and frame-000005"),
            "{warning}"
        );
        assert!(warning.contains("up to 85 degrees"), "{warning}");
        assert_eq!(contradiction(&[of(5, 5.0, false)], &sequence), None);
    }
}
