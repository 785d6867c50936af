//! Provisional depth: keyframes enter the map early, and final depth replaces provisional depth without residue.

use std::collections::BTreeMap;
use std::path::Path;

use crate::program::{contents, expect_status, small_sequence};
use linecarve::Options;
use linecarve::front_end::{
    Arrival, FrontEnd, Keyframe, SemiDenseSource, Source, group_size, run_in_groups,
};
use linecarve::map::Map;
use linecarve::options::SemiDenseStage;
use linecarve_mesh::LineSet;
use linecarve_sequence::{OpenOptions, Sequence};

const FRAMES: usize = 12;
/// Of the runs of the program.
const FEW: usize = 8;
/// About that of the boxes, in metres.
const MEDIAN_DEPTH: f64 = 2.5;

fn source() -> SemiDenseSource {
    SemiDenseSource {
        options: SemiDenseStage::default(),
        median_depth: MEDIAN_DEPTH,
    }
}

fn arrivals(sequence: &Sequence, is_with_first: bool) -> Vec<(usize, Arrival)> {
    let source = Source::SemiDense(Box::new(source()));
    let frames: Vec<usize> = (0..FRAMES).collect();
    let mut arrivals = Vec::new();
    let options = Options::default();
    let mut front_end = FrontEnd::new(&source, &options, frames.len(), None, is_with_first)
        .expect("default options are in range");
    let collect = |number, arrival| {
        arrivals.push((number, arrival));
        Ok::<(), ()>(())
    };
    run_in_groups(
        &mut front_end,
        sequence,
        &frames,
        0,
        group_size(),
        None,
        collect,
    )
    .expect("nothing fails");
    arrivals
}

fn map(sequence: &Sequence) -> Map {
    let options = Options::default();
    Map::of_semi_dense(&options, sequence.color_camera(), &source())
        .expect("default options are in range")
}

fn segments_of(keyframe: &Keyframe) -> usize {
    match keyframe {
        Keyframe::Lines(keyframe) => keyframe.segments.len(),
        _ => 0,
    }
}

/// The bits of the coordinates of the corners.
type Triangle = [[u64; 3]; 3];

fn segments(map: &Map) -> LineSet {
    map.segments().expect("a map of lines").segments()
}

/// The corners of all carved triangles, those that depth rejects as well.
fn carved_triangles(map: &Map) -> Vec<Triangle> {
    let carver = map.carver();
    let corner = |vertex| {
        let position: nalgebra::Point3<f64> = carver.tetrahedra().position(vertex);
        [position.x, position.y, position.z].map(f64::to_bits)
    };
    let mut triangles: Vec<Triangle> = carver
        .triangles()
        .map(|triangle| {
            let mut corners = triangle.map(corner);
            corners.sort_unstable();
            corners
        })
        .collect();
    triangles.sort_unstable();
    triangles
}

fn last(arrival: Arrival) -> Option<Keyframe> {
    match arrival {
        Arrival::Provisional { .. } => None,
        Arrival::Final(keyframe) => Some(keyframe.expect("rendered images are whole")),
    }
}

#[test]
fn first_depths_are_in_the_map_at_once_and_leave_nothing_behind() {
    let folder = small_sequence(FRAMES, "tum");
    let sequence = Sequence::open(&folder.path().join("sequence"), &OpenOptions::default())
        .expect("a sequence of this program");
    let stage = SemiDenseStage::default();

    let mut plain = map(&sequence);
    let mut carved: Vec<Vec<Triangle>> = Vec::new();
    for (_, arrival) in arrivals(&sequence, false) {
        let keyframe = last(arrival).expect("first depths were not asked for");
        plain.push(&keyframe).expect("poses are in range");
        carved.push(carved_triangles(&plain));
    }
    plain.finish().expect("nothing is left");
    assert_eq!(carved.len(), FRAMES);
    assert!(!plain.surface().is_empty());

    let mut refined = map(&sequence);
    let mut waiting: BTreeMap<usize, usize> = BTreeMap::new();
    let mut finished = 0;
    for (number, arrival) in arrivals(&sequence, true) {
        match arrival {
            Arrival::Provisional {
                keyframe,
                delay_keyframes,
            } => {
                assert!(
                    delay_keyframes < stage.future,
                    "keyframe {number} came after {delay_keyframes} others"
                );
                assert!(delay_keyframes + number >= stage.first_neighbours);
                let rays = refined.carver().ray_count();
                refined
                    .push_provisional(&keyframe)
                    .expect("poses are in range");
                assert!(refined.carver().ray_count() > rays);
                assert!(waiting.insert(number, segments_of(&keyframe)).is_none());
                let listed = refined.provisional_segment_count();
                assert_eq!(listed, waiting.values().sum::<usize>());
            }
            Arrival::Final(keyframe) => {
                assert_eq!(number, finished);
                let keyframe = keyframe.expect("rendered images are whole");
                assert!(waiting.remove(&number).is_some(), "{number} came too late");
                refined.push(&keyframe).expect("poses are in range");
                finished += 1;
                if waiting.is_empty() {
                    assert!(carved_triangles(&refined) == carved[number]);
                }
            }
        }
        let segments = refined.provisional_segment_count();
        assert_eq!(segments, waiting.values().sum::<usize>());
    }
    assert_eq!(finished, FRAMES);
    refined.finish().expect("nothing is left");
    assert!(refined.surface() == plain.surface());
    assert!(segments(&refined) == segments(&plain));
}

#[test]
fn a_run_that_ends_early_keeps_last_depths_alone() {
    let folder = small_sequence(FRAMES, "tum");
    let sequence = Sequence::open(&folder.path().join("sequence"), &OpenOptions::default())
        .expect("a sequence of this program");
    let (mut plain, mut refined) = (map(&sequence), map(&sequence));
    for (number, arrival) in arrivals(&sequence, true) {
        match arrival {
            Arrival::Provisional { keyframe, .. } => {
                refined
                    .push_provisional(&keyframe)
                    .expect("poses are in range");
            }
            Arrival::Final(keyframe) => {
                let keyframe = keyframe.expect("rendered images are whole");
                plain.push(&keyframe).expect("poses are in range");
                refined.push(&keyframe).expect("poses are in range");
                if number == 4 {
                    break;
                }
            }
        }
    }
    assert!(carved_triangles(&refined) != carved_triangles(&plain));
    refined.finish().expect("they are there");
    plain.finish().expect("nothing is left");
    assert!(refined.surface() == plain.surface());
    assert_eq!(refined.carver().point_count(), plain.carver().point_count());
    assert_eq!(refined.provisional_segment_count(), 0);
}

#[test]
fn the_files_depend_on_neither_threads_nor_first_depths() {
    let folder = small_sequence(FEW, "tum");
    let text = |path: &Path| path.to_str().expect("temporary paths are UTF-8").to_owned();
    let sequence = text(&folder.path().join("sequence"));
    let files = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let mut arguments = vec![
            "reconstruct".to_owned(),
            sequence.clone(),
            "--out".to_owned(),
            text(&out),
        ];
        let shared = "--depth semi-dense --every 1 --no-picture --no-page --quiet";
        arguments.extend(
            shared
                .split(' ')
                .chain(more.iter().copied())
                .map(str::to_owned),
        );
        expect_status(0, arguments);
        let mut files = contents(&out);
        files.remove(Path::new("report.json"));
        files
    };
    let one = files("one", &["--threads", "1"]);
    let three = files("three", &["--threads", "3"]);
    assert!(one == three);
    let mut final_only = files("final", &["--threads", "2", "--final-only"]);
    let is_growth = |name: &Path| name.starts_with("keyframes");
    assert_eq!(
        one.keys().filter(|name| is_growth(name)).count(),
        FEW,
        "{:?}",
        one.keys()
    );
    final_only.retain(|name, _| !is_growth(name));
    assert!(
        one.iter()
            .filter(|(name, _)| !is_growth(name))
            .eq(final_only.iter())
    );
}
