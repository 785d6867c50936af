//! IFC4 as text (ISO 10303-21): elements with open polygonal face sets, upright, with holes.
//!
//! # Reference
//! buildingSMART, *Industry Foundation Classes, version 4 (ISO 16739-1:2018)*.

use std::fmt::Write as _;
use std::path::Path;

use linecarve_mesh::files::{WriteError, write_atomically};

use super::{Part, parts, texts};
use crate::kind::Kind;
use crate::structure::{Polygon, Structure, StructurePlane};
use crate::surface::{rank, unique};

/// Writes walls, the floor as a slab, the ceiling as a covering, and other planes as plates, in one storey. Only seen surfaces are
/// written: elements have no thickness, and holes are holes of their faces. Triangles on no plane are one proxy.
///
/// # Errors
/// When the file cannot be written.
pub fn write_ifc(path: &Path, structure: &Structure) -> Result<(), WriteError> {
    let mut file = File {
        text: String::new(),
        last: 0,
        points: texts(structure, &structure.upright_from_original()),
    };
    file.fill(structure);
    let generator = concat!("linecarve ", env!("CARGO_PKG_VERSION"));
    write_atomically(path, |out| {
        writeln!(
            out,
            "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION(('ViewDefinition [ReferenceView_V1.2]'),'2;1');"
        )?;
        // No time: the same input gives the same bytes.
        writeln!(
            out,
            "FILE_NAME('structure.ifc','1970-01-01T00:00:00',(''),(''),'{generator}','{generator}','');"
        )?;
        writeln!(
            out,
            "FILE_SCHEMA(('IFC4'));\nENDSEC;\nDATA;\n{}ENDSEC;\nEND-ISO-10303-21;",
            file.text
        )
    })
}

struct File {
    text: String,
    last: usize,
    points: Vec<[String; 3]>,
}

impl File {
    /// Adds an entity and returns a reference to it.
    fn add(&mut self, entity: &str) -> String {
        self.last += 1;
        let _ = writeln!(self.text, "#{}={entity};", self.last);
        format!("#{}", self.last)
    }

    fn fill(&mut self, structure: &Structure) {
        let origin = self.add("IFCCARTESIANPOINT((0.,0.,0.))");
        let axes = self.add(&format!("IFCAXIS2PLACEMENT3D({origin},$,$)"));
        let place = self.add(&format!("IFCLOCALPLACEMENT($,{axes})"));
        let context = self.add(&format!(
            "IFCGEOMETRICREPRESENTATIONCONTEXT($,'Model',3,1.E-06,{axes},$)"
        ));
        let units = [
            "LENGTHUNIT.,$,.METRE",
            "AREAUNIT.,$,.SQUARE_METRE",
            "VOLUMEUNIT.,$,.CUBIC_METRE",
            "PLANEANGLEUNIT.,$,.RADIAN",
        ]
        .map(|unit| self.add(&format!("IFCSIUNIT(*,.{unit}.)")));
        let units = self.add(&format!("IFCUNITASSIGNMENT(({}))", units.join(",")));
        let project = self.add(&format!(
            "IFCPROJECT('{}',$,'structure',$,$,$,$,({context}),{units})",
            identity("project", 0)
        ));
        let site = self.spatial("IFCSITE", "site", &place, "$,$,$,$,$");
        let building = self.spatial("IFCBUILDING", "building", &place, "$,$,$");
        let storey = self.spatial("IFCBUILDINGSTOREY", "storey", &place, "$");
        for (number, (whole, part)) in [(&project, &site), (&site, &building), (&building, &storey)]
            .into_iter()
            .enumerate()
        {
            self.add(&format!(
                "IFCRELAGGREGATES('{}',$,$,$,{whole},({part}))",
                identity("aggregate", number)
            ));
        }
        let parts = parts(structure);
        let parts = parts
            .iter()
            .enumerate()
            .filter(|it| !it.1.polygons.is_empty());
        let elements: Vec<String> = parts
            .map(|(number, part)| {
                let about = structure.planes.get(number);
                self.element(number, part, about, &context, &place)
            })
            .collect();
        if !elements.is_empty() {
            self.add(&format!(
                "IFCRELCONTAINEDINSPATIALSTRUCTURE('{}',$,$,$,({}),{storey})",
                identity("contained", 0),
                elements.join(",")
            ));
        }
    }

    fn spatial(&mut self, class: &str, name: &str, place: &str, more: &str) -> String {
        let id = identity(name, 0);
        self.add(&format!(
            "{class}('{id}',$,'{name}',$,$,{place},$,$,.ELEMENT.,{more})"
        ))
    }

    fn element(
        &mut self,
        number: usize,
        part: &Part<'_>,
        plane: Option<&StructurePlane>,
        context: &str,
        place: &str,
    ) -> String {
        let shape = self.shape(&part.polygons, context);
        let (class, kind) = match part.kind {
            Some(Kind::Floor) => ("IFCSLAB", ".FLOOR."),
            Some(Kind::Ceiling) => ("IFCCOVERING", ".CEILING."),
            Some(Kind::Wall) => ("IFCWALL", ".NOTDEFINED."),
            Some(_) => ("IFCPLATE", ".NOTDEFINED."),
            None => ("IFCBUILDINGELEMENTPROXY", ".NOTDEFINED."),
        };
        let (id, about) = match plane {
            Some(StructurePlane {
                area, rms, sigma, ..
            }) => (
                identity("plane", number),
                format!(
                    "'area {area:.4}, rms {rms:.5}, standard deviation of the offset {sigma:.6}'"
                ),
            ),
            None => (identity("rest", 0), "$".to_owned()),
        };
        let name = &part.name;
        self.add(&format!(
            "{class}('{id}',$,'{name}',{about},$,{place},{shape},$,{kind})"
        ))
    }

    /// Polygons as a face set with its own points.
    fn shape(&mut self, polygons: &[Polygon], context: &str) -> String {
        let used = unique(
            polygons
                .iter()
                .flat_map(|it| it.rings.iter().flatten())
                .copied(),
        );
        // Reals have a point.
        let real = |text: &String| format!("{text}{}", if text.contains('.') { "" } else { "." });
        let points = used.iter().map(|it| self.points[*it as usize].each_ref());
        let points: Vec<String> = points
            .map(|it| format!("({})", it.map(real).join(",")))
            .collect();
        let points = self.add(&format!("IFCCARTESIANPOINTLIST3D(({}))", points.join(",")));
        let mut faces = Vec::new();
        for polygon in polygons {
            let rings: Vec<String> = (polygon.rings.iter())
                .map(|ring| {
                    let rank = |it: &u32| (rank(&used, it) + 1).to_string();
                    format!("({})", ring.iter().map(rank).collect::<Vec<_>>().join(","))
                })
                .collect();
            let entity = match rings.as_slice() {
                [outer] => format!("IFCINDEXEDPOLYGONALFACE({outer})"),
                [outer, holes @ ..] => {
                    format!(
                        "IFCINDEXEDPOLYGONALFACEWITHVOIDS({outer},({}))",
                        holes.join(",")
                    )
                }
                [] => continue,
            };
            faces.push(self.add(&entity));
        }
        let set = self.add(&format!(
            "IFCPOLYGONALFACESET({points},.F.,({}),$)",
            faces.join(",")
        ));
        let body = self.add(&format!(
            "IFCSHAPEREPRESENTATION({context},'Body','Tessellation',({set}))"
        ));
        self.add(&format!("IFCPRODUCTDEFINITIONSHAPE($,$,({body}))"))
    }
}

/// A global identifier, the same in every file for the same name and number: 128 bits in 22 digits of base 64.
fn identity(name: &str, number: usize) -> String {
    const DIGITS: &[u8; 64] = b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz_$";
    // FNV-1a with 128 bits (Fowler, Noll, Vo).
    let mut hash: u128 = 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d;
    for byte in name.bytes().chain(number.to_le_bytes()) {
        hash = (hash ^ u128::from(byte)).wrapping_mul(0x0000_0000_0100_0000_0000_0000_0000_013b);
    }
    let digit = |at: u32| char::from(DIGITS[(hash >> (6 * (21 - at))) as usize & 63]);
    (0..22).map(digit).collect()
}
