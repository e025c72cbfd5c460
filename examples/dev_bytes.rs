//! dev: bytes of a transfer. args: out source target garments...
use dressform::{device::Device, model::*, transfer};
fn main() {
    let a: Vec<String> = std::env::args().skip(1).collect();
    let load = |n: &str| -> Character {
        serde_json::from_slice(&std::fs::read(format!("/work/wt/fixtures/{n}.json")).unwrap()).unwrap()
    };
    let (s, t) = (load(&a[1]), load(&a[2]));
    let gs: Vec<Garment> = a[3..]
        .iter()
        .map(|n| {
            Garment::from_source(
                serde_json::from_slice(&std::fs::read(format!("/work/wt/fixtures/{n}.json")).unwrap())
                    .unwrap(),
            )
            .unwrap()
        })
        .collect();
    let clock = std::time::Instant::now();
    let out = transfer::run(
        &Device::cpu(),
        &transfer::Input {
            source: &s.body,
            target: &t.body,
            garments: gs.iter().map(|g| g.points.as_slice()).collect(),
        },
        &transfer::Params::default(),
    )
    .unwrap();
    eprintln!("{:.2} s wall", clock.elapsed().as_secs_f64());
    let mut bytes = Vec::new();
    for g in out.garments.iter().chain(std::iter::once(&out.body)) {
        for p in g {
            for c in p.iter() {
                bytes.extend(c.to_le_bytes());
            }
        }
    }
    bytes.extend(serde_json::to_vec(&out.infos).unwrap());
    std::fs::write(&a[0], bytes).unwrap();
}
