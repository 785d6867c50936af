//! Whether the images contradict the path: places that were seen again, and models made of matches alone.

use linecarve_sequence::Sequence;
use linecarve_tracking::{LoopReport, MapCheck};

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

/// A warning, when the map of one camera differs from models that were made of matches alone, or could not be compared.
pub(super) fn map_contradiction(check: &MapCheck, sequence: &Sequence) -> Option<String> {
    let name = |frame: u32| &sequence.frames()[frame as usize].name;
    let places = check.contradictions.len();
    let (Some(first), Some(last)) = (check.contradictions.first(), check.contradictions.last())
    else {
        return (check.compared == 0).then(|| {
            "the map could not be confirmed: nowhere do matches alone determine how the camera moved (a flat scene, or hardly any \
             sideways motion). It may be wrong"
                .to_owned()
        });
    };
    let turn = check
        .contradictions
        .iter()
        .map(|one| one.turn_degrees)
        .fold(0.0, f64::max);
    if !check.cuts.is_empty() {
        let cuts: Vec<String> = check
            .cuts
            .iter()
            .map(|[first, last]| format!("{} to {}", name(*first), name(*last)))
            .collect();
        return Some(format!(
            "the map tore: from frame {} the images contradict the poses of the cameras around (turned by up to {turn:.0} degrees). \
             Frames there have no pose, and the parts before and after are sub-maps of their own",
            cuts.join(", and from ")
        ));
    }
    let position = match first.frame == last.frame {
        true => format!("around frame {}", name(first.frame)),
        false => format!(
            "between frames {} and {}",
            name(first.frame),
            name(last.frame)
        ),
    };
    Some(format!(
        "the map may be wrong {position}: at {places} of {} keyframes that were compared, the images contradict the poses of the cameras \
         around (turned by up to {turn:.0} degrees). Give two frames that start the map with --start-pair, or leave out those",
        check.compared,
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
    use linecarve_tracking::Contradiction;

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

    fn six_frames() -> (tempfile::TempDir, Sequence) {
        let folder = tempfile::tempdir().unwrap();
        let mut options = linecarve_synth::SynthOptions::default();
        options.scene = linecarve_synth::SceneKind::Corner;
        options.frames = 6;
        options.width = 32;
        options.height = 24;
        options.layout = linecarve_synth::SequenceLayout::SevenScenes;
        linecarve_synth::write_sequence(&options, folder.path(), &|_, _| {}).unwrap();
        let sequence = Sequence::open(folder.path(), &Default::default()).unwrap();
        (folder, sequence)
    }

    #[test]
    fn a_wrong_map_is_called_wrong() {
        let (_folder, sequence) = six_frames();
        let at = |frame: u32, turn_degrees: f64| Contradiction {
            frame,
            turn_degrees,
            direction_degrees: 40.0,
        };
        let mut check = MapCheck::default();
        check.compared = 5;
        assert_eq!(map_contradiction(&check, &sequence), None);
        check.contradictions.push(at(2, 3.0));
        let warning = map_contradiction(&check, &sequence).unwrap();
        assert!(
            warning.contains("wrong around frame frame-000002: at 1 of 5"),
            "{warning}"
        );
        check.contradictions.push(at(4, 8.2));
        let warning = map_contradiction(&check, &sequence).unwrap();
        assert!(
            warning.contains("frame-000002 and frame-000004"),
            "{warning}"
        );
        assert!(warning.contains("up to 8 degrees"), "{warning}");
        check.cuts.push([1, 4]);
        let warning = map_contradiction(&check, &sequence).unwrap();
        assert!(
            warning.contains("from frame frame-000001 to frame-000004"),
            "{warning}"
        );
        let warning = map_contradiction(&MapCheck::default(), &sequence).unwrap();
        assert!(warning.contains("could not be confirmed"), "{warning}");
    }

    #[test]
    fn the_warning_names_the_frames() {
        let (_folder, sequence) = six_frames();
        let warning = contradiction(&[of(5, 85.2, false)], &sequence).unwrap();
        assert!(
            warning.contains("between frames frame-000003 and frame-000005"),
            "{warning}"
        );
        assert!(warning.contains("up to 85 degrees"), "{warning}");
        assert_eq!(contradiction(&[of(5, 5.0, false)], &sequence), None);
    }
}
