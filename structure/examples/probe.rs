use linecarve_mesh::*;
use linecarve_structure::*;
fn main() {
    let arg: Vec<String> = std::env::args().collect();
    let path = std::path::Path::new(&arg[1]);
    let mesh = read_geometry(path).unwrap().into_mesh();
    let lines = read_geometry(&path.with_file_name("clusters.ply")).unwrap();
    let segments: Vec<_> = lines
        .lines
        .iter()
        .map(|l| l.map(|e| lines.positions[e as usize]))
        .collect();
    let text = std::fs::read(path.with_file_name("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_slice(&text).unwrap();
    let up: [f64; 3] =
        serde_json::from_value(report.pointer("/sequence/up").unwrap().clone()).unwrap();
    let t = std::time::Instant::now();
    let s = structure(
        &mesh,
        &segments,
        &StructureOptions {
            up: up.into(),
            ..Default::default()
        },
    );
    eprintln!(
        "{:?} polygons {} planes {} corners {} rest {} of {} noise {:.5} area poly {:.3} rest {:.3} mesh {:.3}",
        t.elapsed(),
        s.polygons.len(),
        s.planes.len(),
        s.polygons
            .iter()
            .flat_map(|p| &p.rings)
            .map(Vec::len)
            .sum::<usize>(),
        s.rest.len(),
        mesh.triangles.len(),
        s.noise,
        s.planes.iter().map(|p| p.area).sum::<f64>(),
        s.area_of(&s.rest),
        s.mesh_area
    );
    for p in s.planes.iter().take(12) {
        eprintln!(
            "{:?} area {:.3} n {:.4?} off {:.5} rms {:.5} sigma {:.6} al {}",
            p.kind,
            p.area,
            p.normal.as_slice(),
            p.offset,
            p.rms,
            p.sigma,
            p.is_aligned
        );
    }
    for d in s.distances.iter().filter(|d| d.facing) {
        eprintln!("{:?}", d);
    }
    for d in s.angles.iter().take(6) {
        eprintln!("{:?}", d);
    }
    write_mesh_ply(std::path::Path::new(&arg[2]), &s.mesh()).unwrap();
    let t = std::time::Instant::now();
    let dir = path.with_file_name("structure");
    std::fs::create_dir_all(&dir).unwrap();
    let plan = Plan::new(&s);
    eprintln!(
        "plan {:?} {:?}",
        t.elapsed(),
        plan.as_ref()
            .map(|p| (p.height, p.above_floor, p.openings.len()))
    );
    write_json(
        &dir.join("structure.json"),
        &StructureSummary::new(&s, plan.as_ref(), None),
    )
    .unwrap();
    write_structure_glb(
        &dir.join("structure.glb"),
        &s,
        GltfFrame::upright(nalgebra::Vector3::zeros(), &s.up),
    )
    .unwrap();
    write_structure_obj(&dir.join("structure.obj"), &s).unwrap();
    write_dxf(&dir.join("structure.dxf"), &s).unwrap();
    write_ifc(&dir.join("structure.ifc"), &s).unwrap();
    write_usda(&dir.join("structure.usda"), &s).unwrap();
    write_svg(&dir.join("plan.svg"), &s, plan.as_ref()).unwrap();
    eprintln!("written {:?}", t.elapsed());
    let mut m = TriangleMesh {
        positions: vec![],
        triangles: vec![],
        colors: Some(vec![]),
    };
    let mut add = |tris: &[[u32; 3]], c: [u8; 3]| {
        for t in tris {
            let f = m.positions.len() as u32;
            for v in t {
                m.positions.push(s.positions[*v as usize]);
                m.colors.as_mut().unwrap().push(c);
            }
            m.triangles.push([f, f + 1, f + 2]);
        }
    };
    for (i, p) in s.polygons.iter().enumerate() {
        let h = (i as u32 + 1).wrapping_mul(2654435761);
        add(
            &p.triangles,
            [
                80 + (h >> 24) as u8 / 2,
                80 + (h >> 16) as u8 / 2,
                80 + (h >> 8) as u8 / 2,
            ],
        );
    }
    add(&s.rest, [60, 60, 60]);
    write_mesh_ply(std::path::Path::new(&format!("{}.color.ply", arg[2])), &m).unwrap();
}
