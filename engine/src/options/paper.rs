//! The published system as a set of options.

use linecarve_lines::depth::EdgeDepthOptions;
use linecarve_lines::depth::semi_dense::{ConsistencyOptions, NeighbourOptions, SemiDenseOptions};
use linecarve_points::PoseCorrectionOptions;

use super::{
    CarvingOptions, HoleFilling, LabelKind, LandmarkOptions, LineMethod, Options,
    SegmentPointOptions, SemiDenseStage, SurfaceOptions, SurfacePointOptions,
};

impl Options {
    /// Name of the published system that these options are, in reports; `None` for our own.
    pub fn preset(&self) -> Option<&'static str> {
        match self.lines {
            LineMethod::EdgeAided => None,
            LineMethod::Paper => Some("paper"),
        }
    }

    /// The system of the paper that this program grew out of, as printed: Algorithm 1, clusters by first come, end points of segments with their
    /// rays alone, votes, every facet exported, nothing checked or moved. Depth from neighbours has the published thresholds.
    ///
    /// # Reference
    /// S. He, X. Qin, Z. Zhang, M. Jagersand, Incremental 3D Line Segment Extraction from Semi-dense SLAM, ICPR 2018, with depth as in
    /// R. Mur-Artal, J. D. Tardos, RSS 2015, and carving as in D. Lovi et al., 3DPVT 2010.
    pub fn paper() -> Self {
        Self {
            lines: LineMethod::Paper,
            edge_depth: EdgeDepthOptions::raw(),
            semi_dense: SemiDenseStage {
                edge_point_spacing_px: 0,
                is_dense: false,
                neighbours: {
                    let mut options = NeighbourOptions::default();
                    options.count = 7;
                    options
                },
                matching: SemiDenseOptions::published(),
                confirm: {
                    let mut options = ConsistencyOptions::default();
                    options.least_agreeing = 3;
                    options
                },
                ..SemiDenseStage::default()
            },
            segment_points: SegmentPointOptions { spacing_px: None },
            surface_points: SurfacePointOptions {
                enabled: false,
                ..SurfacePointOptions::default()
            },
            landmarks: LandmarkOptions {
                join: false,
                ..LandmarkOptions::default()
            },
            pose_correction: {
                let mut options = PoseCorrectionOptions::default();
                options.enabled = false;
                options
            },
            carving: CarvingOptions {
                labels: LabelKind::Votes,
                free_threshold: 1,
                ray_angle_deg: 0.0,
                ..CarvingOptions::default()
            },
            surface: SurfaceOptions {
                longest_edge_share: None,
                least_measured_share: 0.0,
                minimum_component: 0,
                holes: HoleFilling::None,
                keep_hull: false,
                manifold: false,
            },
            ..Self::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_paper_is_within_the_ranges() {
        Options::paper().validate().unwrap();
        let extract = Options::paper().extract(1.7);
        assert_eq!(extract.paper.unwrap().unit, 1.7);
        assert!(extract.samples.is_none());
        assert!(Options::default().extract(1.7).paper.is_none());
    }
}
