"""Runs a peer's drape and keeps every frame; for the peers' interpreter, not ours.

    peer_frames.py DRAPE_NEWTON.PY OUT.npz STILL_MM ARGUMENTS...

The peer's script reads the process's CPU clock before and after each frame: there we look at its
state. The run ends when no vertex has moved by more than STILL_MM in the last twelve frames, or
where the script ends. Writes `frames` [f, n, 3] and `cpu` [f], seconds spent in frames so far.
"""

import runpy
import sys
import time

import numpy as np

script, out, still = sys.argv[1], sys.argv[2], 1e-3 * float(sys.argv[3])
sys.argv = [script, *sys.argv[4:]]
clock = time.process_time
frames, cpu = [], [0.0]
state = {"start": None, "outside": 0.0}


class Still(Exception):
    """The cloth is at rest."""


def watched() -> float:
    """The CPU clock, less the time spent in here."""
    now = clock()
    scope = sys._getframe(1).f_locals
    if "s0" in scope and "cpus" in scope:
        if state["start"] is None:
            state["start"] = now
        else:
            cpu.append(cpu[-1] + now - state["start"])
            state["start"] = None
        if state["start"] is None or not frames:
            frames.append(scope["s0"].particle_q.numpy().copy())
        if len(frames) > 24:
            recent = np.stack(frames[-12:])
            if np.linalg.norm(recent.max(0) - recent.min(0), axis=1).max() < still:
                raise Still
    return clock()


time.process_time = watched
try:
    runpy.run_path(script, run_name="__main__")
except Still:
    print("still", file=sys.stderr)
np.savez_compressed(out, frames=np.stack(frames), cpu=np.array(cpu[: len(frames)]))
