//! Untangling: what starts on a wrong side gets to its right one, at rest.
//!
//! No time passes and nothing falls; every stage minimises elastic energy and springs, so that
//! the cloth around gives way where a part of it is moved:
//! 1. *Draw*, for starts deep inside of a solid: every point inside is drawn to its way out
//!    ([`super::contact::fixed::Fixed::way_out`]) with contact switched off, which would only
//!    hold up cloth that has centimetres to go.
//! 2. *Lift*, for cloth that passes through a lower layer: out over the layer's folds
//!    ([`super::contact::lift`]), once, with contact against the layers switched off around the
//!    tangle, to an equilibrium.
//! 3. *Push*: springs on all that is tangled ([`super::contact::aim`]) against barriers and
//!    continuous collision detection on all that is clean, a few iterations at a time. What stays
//!    tangled is now and then *carried* out of slots that are too narrow for it
//!    ([`super::contact::pinch`]) or *loosened*: an equilibrium with nothing of the tangled kind in the
//!    way around it, of stiffer cloth about its shape without short folds ([`super::press`]).
//! 4. *Relax*, after a draw: an equilibrium without friction, since the way through the body
//!    left stretch behind that friction would keep.
//!
//! Time steps start after that, and converge by their own residual: a state that was reached by
//! moving points counts only once they hold.

use super::phases::count;
use super::simulation::Simulation;
use super::{Error, FRAME, Info};

/// Starts deeper than this are drawn out before they are pushed [m].
const DEEP: f64 = 0.01;
/// Pushes after which what is still tangled is carried out of slots or loosened.
const PATIENCE: usize = 8;
/// Rings of edges around what is tangled that are loosened, more each time.
const RINGS: usize = 2;
/// Step in which cloth is loosened [s]: with the inertia of a push a crumple would stay one, for it
/// is held stronger than by its bending.
const LOOSE: f64 = 1.0;
/// Most iterations of a draw.
const MOST_DRAWS: usize = 40;

/// Pushes what is tangled to its right side, at most `most` times, with the inertia of steps of
/// `h` [s]; returns whether nothing was tangled.
///
/// A push is a step's minimisation with the springs of tangled pairs in it, which is cut short:
/// its springs come and go as pairs change sides, so it has no minimum worth finding.
pub(super) fn push_out(
    simulation: &mut Simulation<'_>,
    h: f64,
    most: usize,
    info: &mut Info,
) -> Result<bool, Error> {
    simulation.reclassify();
    if most == 0 || simulation.contact.tangles().is_clean() {
        return Ok(true);
    }
    let drawn = draw(simulation, h, info)?;
    // A second lift would pull up what the pushes have brought in place.
    if info.lifts == 0
        && let Some(step) = simulation.lift(FRAME)?
    {
        count(info, &step);
        info.lifts += 1;
        simulation.reclassify();
    }
    for i in 0..most {
        if simulation.contact.tangles().is_clean() {
            break;
        }
        if i % PATIENCE == PATIENCE - 1 {
            free(simulation, info)?;
        }
        let step = simulation.push(h)?;
        count(info, &step);
        info.push_steps += 1;
        simulation.reclassify();
    }
    if drawn && simulation.contact.tangles().is_clean() {
        let step = simulation.relax(FRAME)?;
        count(info, &step);
    }
    Ok(false)
}

/// Carries what stays tangled out of slots or, every third time and where it is in none, loosens it:
/// the more of the cloth around it, the longer it has been tangled.
fn free(simulation: &mut Simulation<'_>, info: &mut Info) -> Result<(), Error> {
    let turn = info.push_steps / PATIENCE;
    let carried = if turn % 3 < 2 { simulation.carry_out(FRAME)? } else { None };
    info.carries += usize::from(carried.is_some());
    let step = match carried {
        Some(step) => step,
        None => simulation.loosen(LOOSE, RINGS * (1 + turn))?,
    };
    count(info, &step);
    simulation.reclassify();
    Ok(())
}

/// Draws what is deep inside of a solid to its way out; returns whether anything was.
fn draw(simulation: &mut Simulation<'_>, h: f64, info: &mut Info) -> Result<bool, Error> {
    if simulation.contact.deepest(&simulation.points()) < DEEP {
        return Ok(false);
    }
    for _ in 0..MOST_DRAWS {
        let step = simulation.draw(h)?;
        count(info, &step);
        info.draws += 1;
        if simulation.contact.deepest(&simulation.points()) < 0.1 * DEEP {
            break;
        }
    }
    simulation.reclassify();
    Ok(true)
}
