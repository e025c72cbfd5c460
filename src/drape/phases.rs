//! The phases of a drape: push out, untangle, settle, repair.

use super::simulation::{Simulation, StepInfo};
use super::untangle::push_out;
use super::{Error, FRAME, Info, Moment, Params};
use crate::model::Vec3;

/// Called after every step.
type Progress<'a> = dyn FnMut(&Moment<'_>) + 'a;

/// Factor by which a settling step is longer than the one before.
const GROWTH: f64 = 2.0;
/// Longest settling step [s]: what is left of inertia then is a thousandth of a node's weight for
/// each millimetre, and the `f32` matrix' rounding is of its size.
pub(super) const LONGEST_STEP: f64 = 1.0;
/// Shortest settling step that is still shortened [s].
const SHORTEST_STEP: f64 = 0.01;
/// What a minimisation on the way to the longest step must promise, see [`Until::gain`].
///
/// [`Until::gain`]: super::minimise::Until::gain
const APPROACH_GAIN: f64 = 2e-3;
/// The same while the cloth is stiffer than its own: other steps of other cloth follow.
const PRESSED_GAIN: f64 = 5e-3;
/// A step is halved at most this often before it is taken as it is.
const MOST_HALVINGS: u32 = 4;
/// Most rounds of pushes, a frame and settling after the phases.
const REPAIR_ROUNDS: usize = 3;

/// Takes the cloth through all phases.
pub(super) fn run(
    simulation: &mut Simulation<'_>,
    params: &Params,
    progress: &mut Progress<'_>,
) -> Result<Info, Error> {
    let mut info = Info { converged: true, pressed: 1.0, ..Info::default() };
    let tangles = simulation.contact.tangles();
    info.inside_before = tangles.inside_count();
    info.crossings_before = [tangles.crossings, tangles.own.len()];
    let h = FRAME / params.steps_per_frame as f64;
    push_out(simulation, h, params.push_steps, &mut info)?;
    untangle(simulation, params, &mut info, progress)?;
    if params.settle && simulation.contact.tangles().is_clean() {
        settle(simulation, params, &mut info, progress)?;
    }
    repair(simulation, params, &mut info, progress)?;
    let tangles = simulation.contact.tangles();
    info.crossings = [tangles.crossings, tangles.own.len()];
    info.kinetic_energy_j = simulation.kinetic_energy();
    info.residual = simulation.net_force();
    info.at_rest = info.residual <= params.rest_tolerance;
    info.contacts = simulation.contact.contacts(&simulation.points()).stencils.len();
    progress(&Moment { share: 1.0, phase: "done", simulation });
    Ok(info)
}

/// The paper's damped frames; where settling follows, only as long as something is tangled. From
/// clean cloth settling finds the same equilibrium in a fraction of the iterations.
fn untangle(
    simulation: &mut Simulation<'_>,
    params: &Params,
    info: &mut Info,
    progress: &mut Progress<'_>,
) -> Result<(), Error> {
    let steps = params.frames * params.steps_per_frame;
    for done in 0..params.frames {
        if params.settle && simulation.contact.tangles().is_clean() {
            break;
        }
        frame(simulation, params, info, &mut |step, simulation| {
            let share = (done * params.steps_per_frame + step) as f64 / (steps + 1) as f64;
            progress(&Moment { share, phase: "untangle", simulation });
        })?;
    }
    Ok(())
}

/// A damped frame, and what is tangled after it; `after` is called with each step's number, from 1.
fn frame(
    simulation: &mut Simulation<'_>,
    params: &Params,
    info: &mut Info,
    after: &mut dyn FnMut(usize, &Simulation<'_>),
) -> Result<(), Error> {
    let h = FRAME / params.steps_per_frame as f64;
    for step in 1..=params.steps_per_frame {
        // Springs of tangled pairs jump, and no step is short enough to converge for certain.
        let halvings = if simulation.contact.tangles().is_clean() { MOST_HALVINGS } else { 0 };
        advance(simulation, h, params.damping, info, halvings)?;
        after(step, simulation);
    }
    info.frames += 1;
    simulation.reclassify();
    Ok(())
}

/// Quasi-static steps until at rest, or to the limit.
///
/// Every step starts at rest, so that only where the cloth ends counts: implicit Euler is then
/// pseudo-transient continuation [Kelley and Keyes 1998] towards static equilibrium. Steps grow
/// while their minimisations succeed, and inertia fades with the square of their length.
///
/// Steps that still grow only *approach*: their minimisations end where little is left to gain
/// ([`APPROACH_GAIN`]), and do not count as converged ones. That of a longest step ends at the
/// tolerance. A step that fails is repeated with a quarter of the length. The first time, steps that
/// grow are of stiffer cloth ([`press`]).
fn settle(
    simulation: &mut Simulation<'_>,
    params: &Params,
    info: &mut Info,
    progress: &mut Progress<'_>,
) -> Result<(), Error> {
    let mut h = FRAME;
    let mut final_step = true;
    let pressed = (info.settle_steps == 0).then(|| simulation.unfolded());
    for i in 0..params.settle_steps {
        simulation.v.iter_mut().for_each(|v| *v = Vec3::zeros());
        if simulation.net_force() <= params.rest_tolerance {
            return Ok(());
        }
        let before = simulation.state();
        let stiffer = pressed.as_ref().map_or(1.0, |_| simulation.press.at(h));
        info.pressed = info.pressed.max(stiffer);
        let step = match &pressed {
            Some(about) if stiffer > 1.0 => simulation.pressed(h, PRESSED_GAIN, stiffer, about)?,
            _ => simulation.quasi_static(h, if h < LONGEST_STEP { APPROACH_GAIN } else { 0.0 })?,
        };
        count(info, &step);
        if !step.converged && !step.approached && h > SHORTEST_STEP {
            simulation.restore(before);
            h *= 0.25;
            continue;
        }
        info.settle_steps += 1;
        final_step = stiffer == 1.0 && (step.converged || !step.approached);
        if final_step {
            record(info, &step);
        } else {
            info.approach_steps += 1;
        }
        h = (GROWTH * h).min(LONGEST_STEP);
        let share = (i + 1) as f64 / (params.settle_steps + 1) as f64;
        progress(&Moment { share, phase: "settle", simulation });
    }
    info.converged &= final_step; // an approach that the limit cut short is no result
    Ok(())
}

/// After the phases: pushes what still crosses. Pushes leave the cloth out of balance, so each round
/// has a frame after it; once clean, the cloth settles again.
fn repair(
    simulation: &mut Simulation<'_>,
    params: &Params,
    info: &mut Info,
    progress: &mut Progress<'_>,
) -> Result<(), Error> {
    let h = FRAME / params.steps_per_frame as f64;
    for _ in 0..REPAIR_ROUNDS {
        if push_out(simulation, h, params.push_steps, info)? {
            break;
        }
        void_steps(info);
        let tangled = !simulation.contact.tangles().is_clean();
        frame(simulation, params, info, &mut |_, _| {})?;
        if tangled && simulation.contact.tangles().is_clean() {
            // The frame did what pushes should have done; what counts is how cloth holds after it.
            void_steps(info);
            frame(simulation, params, info, &mut |_, _| {})?;
        }
        if params.settle && simulation.contact.tangles().is_clean() {
            return settle(simulation, params, info, progress);
        }
    }
    Ok(())
}

/// Forgets how the steps went that a push has made void.
fn void_steps(info: &mut Info) {
    (info.converged, info.unconverged_steps, info.step_residual) = (true, 0, 0.0);
}

/// One step; where it does not converge, two of half the length instead.
pub(super) fn advance(
    simulation: &mut Simulation<'_>,
    h: f64,
    damping: f64,
    info: &mut Info,
    halvings: u32,
) -> Result<(), Error> {
    let before = simulation.state();
    let step = simulation.step(h, damping)?;
    count(info, &step);
    if !step.converged && halvings > 0 {
        simulation.restore(before);
        // Two halves that together take as much velocity away.
        let half = 1.0 - (1.0 - damping).sqrt();
        for _ in 0..2 {
            advance(simulation, 0.5 * h, half, info, halvings - 1)?;
        }
        return Ok(());
    }
    record(info, &step);
    Ok(())
}

/// Counts a step that was made.
fn record(info: &mut Info, step: &StepInfo) {
    info.steps += 1;
    info.unconverged_steps += usize::from(!step.converged);
    info.converged &= step.converged;
    info.step_residual = info.step_residual.max(step.residual);
}

pub(super) fn count(info: &mut Info, step: &StepInfo) {
    info.newton_iterations += step.newton;
    info.cg_iterations += step.cg;
}
