use std::io::Write;

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::*;
use crate::npy::{header_bytes, numbers};

/// Three items of 2 x 2 numbers.
fn stack() -> Vec<u8> {
    let values: Vec<u8> = (0..12).flat_map(|i| (i as f32).to_le_bytes()).collect();
    [header_bytes("'<f4'", &[3, 2, 2]), values].concat()
}

fn archive(path: &Path, members: &[(&str, &[u8])], method: CompressionMethod) {
    let mut writer = ZipWriter::new(std::fs::File::create(path).unwrap());
    let options = SimpleFileOptions::default().compression_method(method);
    for (name, bytes) in members {
        writer.start_file(*name, options).unwrap();
        writer.write_all(bytes).unwrap();
    }
    writer.finish().unwrap();
}

fn item(bytes: &[u8]) -> Vec<f64> {
    let (shape, values) = numbers(bytes).unwrap();
    assert_eq!(shape, [2, 2]);
    values
}

#[test]
fn members_and_items_are_read_in_any_order() {
    let folder = tempfile::tempdir().unwrap();
    for method in [CompressionMethod::Stored, CompressionMethod::Deflated] {
        let path = folder.path().join("a.npz");
        archive(
            &path,
            &[("depth.npy", &stack()), ("x/y.txt", b"text")],
            method,
        );
        let containers = Containers::default();
        assert_eq!(containers.read(&path.join("x/y.txt")).unwrap(), b"text");
        for at in [0, 2, 1, 1, 0, 2] {
            let bytes = containers.read(&path.join("depth.npy").join(at.to_string()));
            let first = f64::from(at) * 4.0;
            assert_eq!(
                item(&bytes.unwrap()),
                [first, first + 1.0, first + 2.0, first + 3.0]
            );
        }
        assert_eq!(names(&path).unwrap(), ["depth.npy", "x/y.txt"]);
        assert_eq!(
            array_header(&path.join("depth.npy")).unwrap().shape,
            [3, 2, 2]
        );
        assert_eq!(file_of(&path.join("depth.npy/2")), path);
    }
    let path = folder.path().join("depth.npy");
    std::fs::write(&path, stack()).unwrap();
    assert_eq!(item(&read(&path.join("2")).unwrap())[0], 8.0);
    assert_eq!(read(&path).unwrap(), stack());
}

#[test]
fn what_is_not_there_or_damaged_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let fortran = String::from_utf8_lossy(&stack()).replace("False", "True ");
    let objects = header_bytes("'|O'", &[3]);
    let short = &stack()[..stack().len() - 20];
    let members: [(&str, &[u8]); 5] = [
        ("depth.npy", &stack()),
        ("fortran.npy", fortran.as_bytes()),
        ("objects.npy", &objects),
        ("short.npy", short),
        ("text.npy", b"no array"),
    ];
    archive(&path, &members, CompressionMethod::Stored);
    for (name, message) in [
        ("depth.npy/3", "3 items"),
        ("missing.npy/0", "missing.npy"),
        ("missing.txt", "missing.txt"),
        ("objects.npy/0", "Python objects"),
        ("short.npy/2", "truncated"),
        ("text.npy/0", "no array of numpy"),
    ] {
        let error = read(&path.join(name)).unwrap_err().to_string();
        assert!(error.contains(message), "{name}: {error}");
    }
    assert!(read(&path.join("fortran.npy/0")).is_err());
    let whole = std::fs::read(&path).unwrap();
    for cut in [0, 3, 40, whole.len() / 2, whole.len() - 1] {
        std::fs::write(&path, &whole[..cut]).unwrap();
        assert!(read(&path.join("depth.npy/1")).is_err(), "{cut}");
        assert!(names(&path).is_err(), "{cut}");
    }
}

#[test]
fn members_that_unpack_to_too_much_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.r3d");
    let zeros = vec![0; (MAX_BYTES + 1) as usize];
    let wide = header_bytes("'<f4'", &[2, 1 << 20, 1 << 20]);
    let members: [(&str, &[u8]); 2] = [("rgbd/0.jpg", &zeros), ("depth.npy", &wide)];
    archive(&path, &members, CompressionMethod::Deflated);
    assert!(std::fs::metadata(&path).unwrap().len() < 1 << 20);
    for name in ["rgbd/0.jpg", "depth.npy/0"] {
        let error = read(&path.join(name)).unwrap_err().to_string();
        assert!(error.contains("256 MB"), "{error}");
    }
}
