"""A gripper with two tactile pads lifts a vial in MuJoCo, loses its grip, feels the vial slip and tightens.

The pads' forces come from gelsim alone: MuJoCo's own contact between pads and vial is off. Prints a table over time, and draws
`mujoco.png` where matplotlib is installed.

    python mujoco_gripper.py [--fidelity draft] [--friction 0.5] [--rate 60] [--blind] [--out mujoco.png]
"""

import argparse
import ctypes.util
import os

if ctypes.util.find_library("OSMesa"):
    os.environ.setdefault("MUJOCO_GL", "osmesa")  # draws without a screen
import mujoco
import numpy as np

import gelsim
from gelsim.adapters.mujoco import Pad

SCENE = """
<mujoco>
  <option timestep="0.001" integrator="implicitfast"/>
  <visual> <global offwidth="900" offheight="1350"/> <quality offsamples="8"/>
    <headlight ambient="0.45 0.45 0.45" diffuse="0.5 0.5 0.5" specular="0 0 0"/> </visual>
  <asset>
    <texture type="skybox" builtin="gradient" rgb1="1 1 1" rgb2="0.9 0.92 0.95" width="32" height="32"/>
  </asset>
  <default>
    <geom contype="0" conaffinity="0" rgba="0.32 0.34 0.38 1"/>
    <default class="pad"> <geom type="box" size="0.002 0.0093 0.00715" mass="0.02" rgba="0.55 0.75 0.68 1"/> </default>
    <default class="finger"> <geom type="box" size="0.004 0.0105 0.0085" mass="0.04"/> </default>
    <default class="dot"> <geom type="sphere" size="0.0009" mass="0" rgba="0.95 0.95 0.9 1"/> </default>
  </default>
  <worldbody>
    <light pos="0.1 -0.2 0.4" dir="-0.25 0.5 -1" diffuse="0.5 0.5 0.5" castshadow="false"/>
    <camera name="view" pos="-0.13 -0.3 0.09" xyaxes="0.917 -0.398 0 0.05 0.115 1" fovy="23"/>
    <geom name="table" type="plane" size="0.15 0.15 0.01" contype="1" conaffinity="1" rgba="0.93 0.93 0.92 1"/>
    <body name="hand" pos="0 0 0.036" gravcomp="1">
      <joint name="lift" type="slide" axis="0 0 1"/>
      <geom type="box" size="0.034 0.012 0.006" pos="0 0 0.066" mass="0.3"/>
      <body name="left" pos="-0.024 0 0" gravcomp="1">
        <joint name="left" type="slide" axis="1 0 0" damping="20"/>
        <geom class="pad" pos="-0.002 0 0"/> <geom class="finger" pos="-0.008 0 0"/>
        <geom type="box" size="0.003 0.008 0.03" pos="-0.009 0 0.034" mass="0.03"/>
        <site name="left" xyaxes="0 -1 0 0 0 -1"/>
      </body>
      <body name="right" pos="0.024 0 0" gravcomp="1">
        <joint name="right" type="slide" axis="-1 0 0" damping="20"/>
        <geom class="pad" pos="0.002 0 0"/> <geom class="finger" pos="0.008 0 0"/>
        <geom type="box" size="0.003 0.008 0.03" pos="0.009 0 0.034" mass="0.03"/>
        <site name="right" xyaxes="0 1 0 0 0 -1"/>
      </body>
    </body>
    <body name="vial" pos="0 0 0.036">
      <freejoint/>
      <geom type="ellipsoid" size="0.014 0.014 0.035" mass="0.2" rgba="0.16 0.47 0.62 1"/>
      <geom type="cylinder" size="0.009 0.003" pos="0 0 -0.033" mass="0" contype="1" conaffinity="1" rgba="0.16 0.47 0.62 1"/>
      <geom type="cylinder" size="0.0075 0.004" pos="0 0 0.032" mass="0" rgba="0.95 0.95 0.9 1"/>
      <!-- braille on its left side, read from there: g -->
      <geom class="dot" pos="-0.0133 0.00125 0.0015"/> <geom class="dot" pos="-0.0133 -0.00125 0.0015"/>
      <geom class="dot" pos="-0.0133 0.00125 -0.001"/> <geom class="dot" pos="-0.0133 -0.00125 -0.001"/>
    </body>
  </worldbody>
  <equality> <joint joint1="left" joint2="right"/> </equality>
  <actuator>
    <position name="lift" joint="lift" kp="4000" dampratio="1"/>
    <motor name="left" joint="left"/> <motor name="right" joint="right"/>
  </actuator>
</mujoco>"""

LIFT_S, FADE_S, END_S = (0.4, 1.0), 1.1, 2.4
GRIP_N, FADE_N_PER_S = 4.0, 3.5
LOST_MM = 10.0
ROW = "{time_s:6.2f}  {grip_n:6.2f}  {pressed_n:9.3f}  {tangential_n:12.3f}  {state:10}  {height_mm:9.2f}  {slipped_mm:10.2f}"
PATIENCE = 4  # frames of gross slip before the controller tightens
ARROWS = 4  # times as long as the markers moved
BAND = {"incipient": "#fbe3b5", "gross": "#f2a6a0"}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fidelity", default="standard")
    parser.add_argument("--friction", type=float, default=0.5)
    parser.add_argument("--rate", type=int, default=60, help="tactile frames a second")
    parser.add_argument("--blind", action="store_true", help="never tightens")
    parser.add_argument("--out", default="mujoco.png")
    args = parser.parse_args()

    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    simulator = gelsim.Simulator("gelsight-mini", args.fidelity, set={"markers.pitch_mm": 1.2})
    pads = [Pad(simulator, model, site, ["vial"], friction=args.friction) for site in ("left", "right")]

    frames, slipping, tight = [], 0, False
    print("time s  grip N  pressed N  tangential N  slip state  height mm  slipped mm")
    while data.time < END_S:
        mujoco.mj_step1(model, data)
        grip_n = GRIP_N * min(data.time / 0.1, 1.0)
        if not tight:
            grip_n = max(grip_n - FADE_N_PER_S * max(data.time - FADE_S, 0.0), 0.2)

        if data.time * args.rate >= len(frames):
            left, right = [pad.sense(data) for pad in pads]
            slipping = slipping + 1 if data.time > FADE_S and left.slip_state == right.slip_state == "gross" else 0
            tight = tight or (slipping == PATIENCE and not args.blind)
            height_mm, hand_mm = (1e3 * data.body(name).xpos[2] for name in ("vial", "hand"))
            held_mm = frames[-1]["held_mm"] if data.time > LIFT_S[0] else hand_mm - height_mm
            frames.append({
                "time_s": data.time, "grip_n": grip_n, "pressed_n": -left.wrench[2], "tangential_n": left.wrench[1],
                "state": left.slip_state, "height_mm": height_mm, "slipped_mm": hand_mm - height_mm - held_mm,
                "held_mm": held_mm, "presses": (left, right), "qpos": data.qpos.copy(),
            })  # fmt: skip
            if len(frames) % max(args.rate // 15, 1) == 1:
                print(ROW.format(**frames[-1]))
            if frames[-1]["slipped_mm"] > LOST_MM:
                print("the vial is lost")
                break

        start, end = LIFT_S
        data.actuator("left").ctrl = data.actuator("right").ctrl = grip_n
        data.actuator("lift").ctrl = 0.03 * np.clip((data.time - start) / (end - start), 0.0, 1.0)
        data.xfrc_applied[:] = 0.0
        for pad in pads:
            pad.push(data)
        mujoco.mj_step2(model, data)
    draw(model, frames, args)


def scene_picture(model, qpos):
    """The scene as MuJoCo draws it; None where nothing can draw."""
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    try:
        with mujoco.Renderer(model, 1320, 880) as renderer:
            renderer.update_scene(data, "view")
            return renderer.render()
    except Exception as error:
        return print(f"the scene is not drawn: {error}")


def draw(model, frames, args):
    """Both pads before, in and after the slip, and forces and height over time."""
    try:
        from matplotlib import pyplot
    except ImportError:
        return print(f"for the picture {args.out}: pip install matplotlib")
    of = lambda key: np.array([frame[key] for frame in frames])
    time_s, states, normal_n, tangential_n = of("time_s"), of("state"), of("pressed_n"), of("tangential_n")
    slips = np.flatnonzero((states == "gross") & (time_s > FADE_S))
    last = slips[-1] if len(slips) else len(frames) // 2
    shown = {"held": np.searchsorted(time_s, FADE_S), "slipping": last, "after": last + args.rate // 3}
    shown = {name: min(number, len(frames) - 1) for name, number in shown.items()}

    pyplot.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    figure = pyplot.figure(figsize=(10.4, 7.4), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[1.5, 1])
    scene, images = above.subfigures(1, 2, width_ratios=[1, 2.95])
    axes = scene.subplots()
    axes.set_axis_off()
    picture = scene_picture(model, frames[last]["qpos"])
    if picture is not None:
        axes.imshow(picture)
    for row, line in enumerate(images.subplots(2, 3, gridspec_kw={"wspace": 0.02, "hspace": 0.02})):
        for axes, (name, number) in zip(line, shown.items()):
            press = frames[number]["presses"][row]
            axes.imshow(press.image)
            rest, moved = press.markers["rest_px"], press.markers["moved_px"]
            axes.quiver(*rest.T, *(moved - rest).T, angles="xy", scale_units="xy", scale=1 / ARROWS, color="white", width=0.004)
            axes.set(xticks=[], yticks=[], title="" if row else f"{name}, {time_s[number]:.2f} s", xlim=(0, 320), ylim=(240, 0))
            axes.spines[:].set_visible(False)
        line[0].set_ylabel(["left pad", "right pad"][row])

    force, path = below.subplots(1, 2)
    for axes in (force, path):
        for state, color in BAND.items():
            band = {"step": "post", "color": color, "lw": 0, "transform": axes.get_xaxis_transform()}
            axes.fill_between(time_s, 0, 1, where=states == state, label=f"{state} slip" if axes is path else None, **band)
        for number in shown.values():
            axes.axvline(time_s[number], color="0.6", lw=0.8, ls=":")
    force.plot(time_s, normal_n, color="#1f77b4", label="normal")
    force.plot(time_s, args.friction * normal_n, color="#1f77b4", ls="--", lw=1, label=f"{args.friction:g} x normal")
    force.plot(time_s, tangential_n, color="#222222", label="tangential")
    force.set(xlabel="time, s", ylabel="force on the left pad, N", xlim=(0, END_S), ylim=(0, None))
    path.plot(time_s, of("height_mm") - frames[0]["height_mm"], color="#2a7f62", label="lifted")
    path.plot(time_s, of("slipped_mm"), color="#c0392b", label="slipped in the grip")
    path.set(xlabel="time, s", ylabel="vial, mm", xlim=(0, END_S), ylim=(-1, None))
    for axes in (force, path):
        axes.legend(frameon=False, ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.0), columnspacing=1.2, handlelength=1.6)
    figure.savefig(args.out, dpi=130)


if __name__ == "__main__":
    main()
