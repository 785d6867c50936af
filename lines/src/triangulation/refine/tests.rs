use super::*;
use crate::depth::{InverseDepth, InverseDepthMap};
use crate::triangulation::SampleOptions;

const SIGMA: f32 = 0.002;

fn samples(rho: impl Fn(f64, f64) -> f64) -> SurfaceSamples {
    let mut map = InverseDepthMap::unknown(320, 240).unwrap();
    for y in 0..240 {
        for x in 0..320 {
            map.set(
                x,
                y,
                InverseDepth::new(rho(x as f64, y as f64) as f32, SIGMA),
            );
        }
    }
    SurfaceSamples::measure(&map, &SampleOptions::default())
}

fn deviations(triangulation: &ImageTriangulation, samples: &SurfaceSamples) -> Vec<f64> {
    triangulation
        .triangles(samples)
        .filter(|triangle| triangle.samples > 0)
        .map(|triangle| triangle.deviation_sigmas)
        .collect()
}

const WIDE: RefineOptions = RefineOptions {
    bound_sigmas: 1.0,
    minimum_distance_px: 4.0,
    largest_gap_px: 80.0,
    relative_error: 0.0,
};

#[test]
fn a_plane_needs_no_vertex_but_those_that_close_gaps() {
    let samples = samples(|x, y| 0.5 + 0.0004 * x - 0.0002 * y);
    let mut triangulation = ImageTriangulation::new(&[]);
    assert_eq!(triangulation.refine(&samples, &WIDE).len(), 4 * 3);
    assert!(
        deviations(&triangulation, &samples)
            .iter()
            .all(|d| *d < 1e-2)
    );
}

#[test]
fn a_curved_surface_is_followed_within_the_bound() {
    let samples =
        samples(|x, y| 0.5 + 0.05 * (-((x - 150.0).powi(2) + (y - 110.0).powi(2)) / 3000.0).exp());
    let mut triangulation = ImageTriangulation::new(&[]);
    let inserted = triangulation.refine(&samples, &WIDE).len();
    // A grid that resolves it everywhere would take thousands.
    assert!((30..200).contains(&inserted), "{inserted}");
    let worst = deviations(&triangulation, &samples)
        .into_iter()
        .fold(0.0, f64::max);
    assert!(worst <= 1.0, "{worst}");
}

#[test]
fn a_step_gets_vertices_on_both_sides_and_none_between() {
    let samples = samples(|x, _| if x < 160.0 { 0.6 } else { 0.4 });
    let mut triangulation = ImageTriangulation::new(&[]);
    let options = RefineOptions {
        minimum_distance_px: 8.0,
        ..WIDE
    };
    let (mut near, mut far) = (0, 0);
    for vertex in triangulation.refine(&samples, &options) {
        assert!((vertex.rho - 0.6).abs() < 1e-5 || (vertex.rho - 0.4).abs() < 1e-5);
        near += usize::from((140.0..160.0).contains(&vertex.pixel.x));
        far += usize::from((160.0..180.0).contains(&vertex.pixel.x));
    }
    assert!(near >= 10 && far >= 10, "{near} and {far} along the step");
    assert!(near + far < 200, "{near} and {far} along the step");
}

#[test]
fn what_the_map_holds_already_is_not_measured_again() {
    let surface = |x: f64, y: f64| 0.5 + 0.0004 * x + 0.0003 * y;
    let samples = samples(surface);
    let known: Vec<ImageVertex> = (0..=8)
        .flat_map(|i| (0..=6).map(move |j| (f64::from(i) * 40.0, f64::from(j) * 40.0)))
        .map(|(x, y)| ImageVertex {
            pixel: Point2::new(x, y),
            rho: surface(x, y),
        })
        .collect();
    let mut triangulation = ImageTriangulation::new(&known);
    assert!(triangulation.refine(&samples, &WIDE).is_empty());
}

#[test]
fn hostile_vertices_are_left_out() {
    let samples = samples(|_, _| 0.5);
    let at = |x, y, rho| ImageVertex {
        pixel: Point2::new(x, y),
        rho,
    };
    let vertices = [
        at(f64::NAN, 0.0, 0.5),
        at(1e300, 0.0, 0.5),
        at(1e-200, -1e-200, 0.5),
        at(10.0, 10.0, -1.0),
        at(10.0, 10.0, 0.5),
        at(10.0, 10.0, 0.5),
        at(200.0, 10.0, 0.5),
        at(200.0, 200.0, 0.5),
        at(10.0, 200.0, 0.5),
    ];
    let mut triangulation = ImageTriangulation::new(&vertices);
    triangulation.refine(&samples, &WIDE);
    assert!(triangulation.triangles(&samples).count() > 4);
    let nothing = SurfaceSamples::default();
    let mut triangulation = ImageTriangulation::new(&vertices);
    assert!(triangulation.refine(&nothing, &WIDE).is_empty());
}
