"""Times touch in the loop of MuJoCo: a knob of 4 mm rests on a GelSight Mini with markers by 1 N and is pushed to and fro until it slips.

    OMP_NUM_THREADS=1 RAYON_NUM_THREADS=1 taskset -c 0 python tests/bench/live.py [--fidelity standard] [--frames 600] [--cpu]

Prints milliseconds a frame of 1/60 s: `step` is `Simulator.step`, `read` image, markers and wrench of what it gives, `loop` these, the
adapter and MuJoCo's eight steps. With `--cpu` they are CPU time, for a machine that others use.
"""

import argparse
import time

import gelsim
import mujoco
import numpy
from gelsim.adapters.mujoco import Pad

SCENE = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <site name="pad"/>
    <body name="knob" pos="0 0 0.0035">
      <joint type="slide" axis="1 0 0" damping="2"/> <joint type="slide" axis="0 1 0" damping="2"/> <joint type="slide" axis="0 0 1"/>
      <geom type="sphere" size="0.004" mass="0.1" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
</mujoco>"""


class Timed:
    """A simulator whose steps are timed."""

    def __init__(self, simulator, clock):
        self.simulator, self.clock, self.seconds = simulator, clock, 0.0

    def __getattr__(self, name):
        return getattr(self.simulator, name)

    def step(self, *arguments, **options):
        start = self.clock()
        press = self.simulator.step(*arguments, **options)
        self.seconds += self.clock() - start
        return press


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fidelity", default="standard")
    parser.add_argument("--frames", type=int, default=600)
    parser.add_argument("--cpu", action="store_true")
    args = parser.parse_args()
    clock = time.process_time if args.cpu else time.perf_counter
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    simulator = gelsim.Simulator("gelsight-mini", args.fidelity, resolution_px=(320, 240), set={"markers.pitch_mm": 1.5})
    pad = Pad(simulator, model, "pad", ["knob"], friction=0.5)
    timed = pad.touch.simulator = Timed(pad.touch.simulator, clock)
    rows, states = [], []
    for frame in range(args.frames):
        start, timed.seconds, reading = clock(), 0.0, 0.0
        for number in range(8):
            mujoco.mj_step1(model, data)
            if number == 0:
                press = pad.sense(data)
                begun = clock()
                press.image, press.markers, press.wrench, states.append(press.slip_state)
                reading = clock() - begun
            turn = 20.0 * data.time
            data.xfrc_applied[:] = 0.0
            data.xfrc_applied[1, :2] = 0.6 * min(data.time, 1.0) * numpy.array([numpy.cos(turn), numpy.sin(turn)])
            pad.push(data)
            mujoco.mj_step2(model, data)
        rows.append([timed.seconds, reading, clock() - start])
    milliseconds = 1e3 * numpy.array(rows[30:])
    print(f"{simulator.fidelity}, {len(milliseconds)} frames: " + ", ".join(f"{states.count(each)} {each}" for each in sorted(set(states))))
    print("          median    mean  worst 1 %")
    for name, each in zip(["step", "read", "loop"], milliseconds.T):
        print(f"{name:6} {numpy.median(each):8.2f} {each.mean():8.2f} {numpy.percentile(each, 99):9.2f}   ms")


if __name__ == "__main__":
    main()
