use super::*;
use crate::depth::InverseDepth;

#[test]
fn refusals() {
    let mut extractor = SegmentExtractor::new(ExtractOptions::default()).unwrap();
    let camera = Camera::pinhole(50.0, 50.0, 20.0, 15.0).unwrap();
    let image = GrayImage::new(40, 30, vec![0; 1200]).unwrap();
    let map = InverseDepthMap::unknown(40, 31).unwrap();
    assert!(matches!(
        extractor.extract(&image, &map, &camera, 0),
        Err(ExtractError::Size {
            depth_height: 31,
            ..
        })
    ));
}

#[test]
fn no_depth_gives_no_segment() {
    let mut extractor = SegmentExtractor::new(ExtractOptions::default()).unwrap();
    let camera = Camera::pinhole(50.0, 50.0, 20.0, 15.0).unwrap();
    let image = GrayImage::new(
        40,
        30,
        (0..1200)
            .map(|i| if i % 40 < 20 { 0 } else { 200 })
            .collect(),
    )
    .unwrap();
    let mut map = InverseDepthMap::unknown(40, 30).unwrap();
    let extraction = extractor.extract(&image, &map, &camera, 0).unwrap();
    assert!(extraction.edge_pixels > 20);
    assert_eq!(
        (extraction.segments.len(), extraction.edge_pixels_with_depth),
        (0, 0)
    );
    for y in 0..30 {
        for x in 0..40 {
            map.set(x, y, InverseDepth::new(0.5, 0.002));
        }
    }
    assert_eq!(
        extractor
            .extract(&image, &map, &camera, 0)
            .unwrap()
            .segments
            .len(),
        1
    );
}
