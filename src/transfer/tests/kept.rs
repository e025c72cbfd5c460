//! Prepared transfers in memory and in files.

use super::*;

#[test]
fn a_stored_transfer_carries_to_the_same_bytes() {
    let source = sphere(Vec3::zeros(), 0.12, 4);
    let target = mapped(&source, |p| Vec3::new(1.2 * p.x, 0.9 * p.y, p.z));
    let garment = sphere(Vec3::zeros(), 0.33, 3).points;
    let device = Device::cpu();
    let params = Params::default();
    let prepared = prepare(&device, &source, &target, &params).unwrap();
    let key = [7; 32];
    let bytes = store::encode(&prepared, &key);
    let read = store::decode(&bytes, &key, &params).unwrap();
    let (a, b) = (prepared.carry(&device, &garment).unwrap(), read.carry(&device, &garment).unwrap());
    assert_eq!(a.points, b.points);
    assert_eq!(prepared.body(), read.body());
    let account = |p: &Prepared, c| serde_json::to_string(&p.info(c, &p.near(&garment))).unwrap();
    assert_eq!(account(&prepared, &a), account(&read, &b));
    assert_eq!(store::encode(&read, &key), bytes);

    assert!(store::decode(&bytes, &[8; 32], &params).is_none(), "another key");
    for cut in [0, 50, 200, bytes.len() - 1] {
        assert!(store::decode(&bytes[..cut], &key, &params).is_none(), "cut at {cut}");
    }
    for at in [0, 20, 30, 60, 100, bytes.len() / 2, bytes.len() - 1] {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1;
        assert!(store::decode(&damaged, &key, &params).is_none(), "damaged at {at}");
    }
}

#[test]
fn a_cache_solves_a_pair_once() {
    use cache::Origin;
    let source = sphere(Vec3::zeros(), 0.05, 3);
    let target = mapped(&source, |p| p * 1.05);
    let garment = sphere(Vec3::zeros(), 0.06, 2).points;
    let device = Device::cpu();
    let params = Params::default();
    let folder = std::env::temp_dir().join(format!("dressform-cache-{}", std::process::id()));
    let points = |cache: &Cache, params: &Params| {
        let found = cache.prepare(&device, &source, &target, params).unwrap();
        (found.prepared.carry(&device, &garment).unwrap().points, found.origin, found.note)
    };
    let cache = Cache::default().on_disk(&folder);
    let (first, origin, note) = points(&cache, &params);
    assert_eq!((origin, note), (Origin::Solved, None));
    assert_eq!(points(&cache.clone(), &params), (first.clone(), Origin::Memory, None));
    let fresh = || Cache::default().on_disk(&folder);
    assert_eq!(points(&fresh(), &params), (first.clone(), Origin::Disk, None));
    assert_eq!(points(&Cache::default(), &params).1, Origin::Solved);
    let stiff = Params { beta: 2e6, ..params.clone() };
    assert_eq!(points(&cache, &stiff).1, Origin::Solved);

    for file in std::fs::read_dir(&folder).unwrap() {
        std::fs::write(file.unwrap().path(), b"not a transfer").unwrap();
    }
    let (again, origin, note) = points(&fresh(), &params);
    assert_eq!((again, origin), (first.clone(), Origin::Solved));
    assert!(note.unwrap().contains("damaged"));
    assert_eq!(points(&fresh(), &params).1, Origin::Disk, "the damaged file was replaced");
    std::fs::remove_dir_all(&folder).unwrap();
    std::fs::write(&folder, b"a file where a folder should be").unwrap();
    let (again, origin, note) = points(&fresh(), &params);
    assert_eq!((again, origin), (first, Origin::Solved));
    assert!(note.unwrap().contains("cannot be written"));
    std::fs::remove_file(&folder).unwrap();
}
