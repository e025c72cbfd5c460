use super::*;
use crate::geometry::skinning::Mat4;
use crate::geometry::surface::tests::sphere;

/// Balls of radius 1 at `centers`, each on a joint of its own.
fn balls(centers: &[Vec3]) -> Character {
    let mut character = Character { skin: Skin { influences: 1, ..Skin::default() }, ..Character::default() };
    for (joint, center) in centers.iter().enumerate() {
        let ball = sphere(30, 40);
        let first = character.body.points.len() as u32;
        character.skin.joint_indices.extend(vec![joint as u32; ball.points.len()]);
        character.skin.joint_weights.extend(vec![1.0; ball.points.len()]);
        character.body.points.extend(ball.points.iter().map(|p| p + center));
        character.body.triangles.extend(ball.triangles.iter().map(|t| t.map(|i| i + first)));
    }
    character
}

/// A ball of cloth around the origin that follows one joint.
fn shell(radius: f64, joint: u32) -> (TriMesh, Skin) {
    let mut mesh = sphere(24, 32);
    mesh.points.iter_mut().for_each(|p| *p *= radius);
    let count = mesh.points.len();
    let skin = Skin { influences: 1, joint_indices: vec![joint; count], joint_weights: vec![1.0; count] };
    (mesh, skin)
}

fn moved(by: Vec3) -> Mat4 {
    Mat4::new_translation(&by)
}

fn figures(character: &Character, cloth: &(TriMesh, Skin), matrices: Vec<Mat4>) -> PoseFigures {
    let body = OuterSkin {
        surface: Surface::new(character.body.clone()),
        point_of: (0..character.body.points.len() as u32).collect(),
    };
    let pose = Pose { name: "made".to_owned(), matrices };
    let cloths = [Cloth { mesh: &cloth.0, skin: &cloth.1 }];
    measure(character, &body, &cloths, &[pose]).remove(0).remove(0)
}

#[test]
fn what_follows_its_body_stays_outside_and_is_not_stretched() {
    let character = balls(&[Vec3::zeros()]);
    let turn = Mat4::from_euler_angles(0.4, -1.0, 2.0) * moved(Vec3::new(3.0, 0.0, 1.0));
    let found = figures(&character, &shell(1.05, 0), vec![turn]);
    assert_eq!((found.inside, found.depth_max_m, found.overlapped), (0.0, 0.0, 0.0));
    assert!(found.edge_stretch.iter().all(|s| (s - 1.0).abs() < 1e-12));
}

#[test]
fn a_body_that_moves_alone_goes_through_its_cloth() {
    // The ball goes 0.3 to +X; the cloth at radius 1.05 stays.
    let character = balls(&[Vec3::zeros()]);
    let mut cloth = shell(1.05, 1);
    let found = figures(&character, &cloth, vec![moved(Vec3::new(0.3, 0.0, 0.0)), Mat4::identity()]);
    let depth = |p: &Vec3| 1.0 - (p - Vec3::new(0.3, 0.0, 0.0)).norm();
    let inside = cloth.0.points.iter().filter(|p| depth(p) > 0.01).count() as f64;
    let share = inside / cloth.0.points.len() as f64;
    assert!((found.inside - share).abs() < 0.02, "{} {share}", found.inside);
    assert!((found.depth_max_m - 0.25).abs() < 0.01, "{}", found.depth_max_m);
    let mean = cloth.0.points.iter().map(|p| depth(p).max(0.0)).sum::<f64>() / cloth.0.points.len() as f64;
    assert!((found.depth_mean_m - mean).abs() < 0.005);
    // What was inside before is not counted.
    cloth.0.points.iter_mut().for_each(|p| *p *= 0.9);
    let found = figures(&character, &cloth, vec![moved(Vec3::new(0.3, 0.0, 0.0)), Mat4::identity()]);
    assert_eq!(found.inside, 0.0);
}

#[test]
fn where_the_body_overlaps_itself_is_not_counted() {
    // Two balls 2.5 apart come to 1.6 apart: the caps between overlap, and so does the cloth there.
    let character = balls(&[Vec3::zeros(), Vec3::new(2.5, 0.0, 0.0)]);
    let together = vec![Mat4::identity(), moved(Vec3::new(-0.9, 0.0, 0.0))];
    let found = figures(&character, &shell(1.05, 0), together);
    assert!(found.overlapped > 0.0);
    // What is left lies in the ring between the balls, no deeper than its height above the skin,
    // though the cloth reaches 0.45 deep into the other ball.
    assert!(found.inside < 0.05 && found.depth_max_m < 0.05, "{found:?}");
}

#[test]
fn skin_that_comes_through_between_vertices_is_seen() {
    // A coarse ball of cloth on a finer one: its faces' centres are 0.94 of the radius from the middle.
    let character = balls(&[Vec3::zeros()]);
    let mut mesh = sphere(6, 8);
    mesh.points.iter_mut().for_each(|p| *p *= 1.3);
    let (count, faces) = (mesh.points.len(), mesh.triangles.len() as f64);
    let skin = Skin { influences: 1, joint_indices: vec![1; count], joint_weights: vec![1.0; count] };
    // The body grows by a quarter: every vertex is still outside, most centres are not.
    let grown = Mat4::new_scaling(1.25);
    let centre = |t: usize| mesh.corners(t).iter().sum::<Vec3>().norm() / 3.0;
    let share = (0..mesh.triangles.len()).filter(|&t| centre(t) < 1.24).count() as f64 / faces;
    let deepest = (0..mesh.triangles.len()).map(|t| 1.25 - centre(t)).fold(0.0, f64::max);
    let found = figures(&character, &(mesh, skin), vec![grown, Mat4::identity()]);
    assert_eq!(found.inside, 0.0);
    assert!(share > 0.5 && (found.faces_inside - share).abs() < 0.05, "{found:?} {share}");
    assert!((found.faces_depth_max_m - deepest).abs() < 0.01, "{found:?} {deepest}");
}

#[test]
fn stretch_is_that_of_the_edges() {
    let character = balls(&[Vec3::zeros()]);
    let points = vec![Vec3::new(2.0, 0.0, 0.0), Vec3::new(2.0, 1.0, 0.0), Vec3::new(2.0, 0.0, 1.0)];
    let mesh = TriMesh { points, triangles: vec![[0, 1, 2]] };
    let skin = Skin { influences: 1, joint_indices: vec![0, 1, 0], joint_weights: vec![1.0; 3] };
    let found = figures(&character, &(mesh, skin), vec![Mat4::identity(), moved(Vec3::y())]);
    assert_eq!(found.edge_stretch_max, 2.0);
    assert_eq!(found.edge_stretch[0], 1.0);
}

#[test]
fn poses_are_chosen_by_name() {
    let set = PoseSet::default();
    let params = |name: &str| Params { enabled: true, poses: vec![name.to_owned()] };
    assert!(chosen(&set, &params("sit")).unwrap().is_empty());
    assert_eq!(chosen(&set, &params("fly")).unwrap_err(), "fly");
}
