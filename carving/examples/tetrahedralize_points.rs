//! Computes the Delaunay tetrahedralisation of random points.

#![allow(clippy::print_stdout, reason = "examples print their result")]

use std::error::Error;

use linecarve_carving::Tetrahedralization;
use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const POINTS: usize = 10_000;

fn main() -> Result<(), Box<dyn Error>> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let points: Vec<Point3<f64>> = (0..POINTS)
        .map(|_| Point3::from(std::array::from_fn::<f64, 3, _>(|_| random.random())))
        .collect();
    let (tetrahedra, _) = Tetrahedralization::from_points(&points)?;
    println!(
        "{} points, {} tetrahedra",
        tetrahedra.vertex_count(),
        tetrahedra.finite_cell_count()
    );
    Ok(())
}
