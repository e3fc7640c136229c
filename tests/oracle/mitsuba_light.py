"""Light of a press by Mitsuba 3, for `physics::transport`: `python mitsuba_light.py SCENE.json LIGHT.json`.

Reads the coat's heights and the panels that shine, and writes for each pixel and channel the light from the LEDs, by way
of the window, and by one bounce. Places are in mm: x to the right, y down, z towards the camera.
"""

import json
import sys
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
PATHS = 400


def walls(scene):
    """Half the width and height of the slab, which holds view and LEDs."""
    view = [0.5 * (scene[side] - 2) * mm for side, mm in zip(["width", "height"], scene["mm_per_px"], strict=True)]
    ends = [[abs(led["middle"][k]) + abs(led["along"][k]) + 0.5 for led in scene["leds"]] for k in [0, 1]]
    return [max(view[k], *ends[k]) for k in [0, 1]]


def write_coat(path, scene):
    """The coat as a mesh with the normals of the tracer: centred differences."""
    heights = np.array(scene["heights"]).reshape(scene["height"], scene["width"])
    # Beyond its border the coat goes on as it ends there, up to the walls.
    heights = np.pad(heights, 1, "edge")
    rows, columns = heights.shape
    along = [(np.arange(size) - (size - 1) / 2) * mm for size, mm in zip([columns, rows], scene["mm_per_px"], strict=True)]
    for places, wall in zip(along, walls(scene), strict=True):
        places[[0, -1]] = -wall, wall
    down, right = np.gradient(heights, along[1], along[0])
    normals = np.dstack([-right, -down, np.ones_like(heights)])
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    places = np.dstack([*np.meshgrid(*along), heights])
    y, x = np.mgrid[:rows, :columns]
    corner = (y[:-1, :-1] * columns + x[:-1, :-1]).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + columns + 1], 1),
            np.stack([corner, corner + columns + 1, corner + columns], 1),
        ]
    )
    header = f"ply\nformat ascii 1.0\nelement vertex {rows * columns}\n"
    header += "".join(f"property float {name}\n" for name in ["x", "y", "z", "nx", "ny", "nz"])
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    with path.open("w") as file:
        file.write(header)
        np.savetxt(file, np.concatenate([places, normals], 2).reshape(-1, 6), "%.7g")
        np.savetxt(file, np.column_stack([np.full(len(faces), 3), faces]), "%d")


def panel(led, scene):
    """A rectangle that shines: Lambert's law is a lobe of 1."""
    middle, along, up, aim = (np.array(led[name]) for name in ["middle", "along", "up", "aim"])
    steps = (np.arange(20) + 0.5) / 10 - 1
    u, v = (grid.ravel()[:, None] for grid in np.meshgrid(steps, steps))
    places = middle + u * along + v * up
    square = (places**2).sum(1)
    in_middle = ((-places @ aim) / np.sqrt(square) / square).mean()
    area = 4 * np.linalg.norm(along) * np.linalg.norm(up)
    radiance = np.pi * scene["diffuse"] / (scene["albedo"] * area * in_middle) * np.array(led["color"])
    to_world = np.eye(4)
    to_world[:3] = np.column_stack([along, up, aim, middle])
    if np.linalg.det(to_world[:3, :3]) < 0:
        to_world[:3, 0] *= -1
    emitter = {"type": "area", "radiance": {"type": "rgb", "value": radiance.tolist()}}
    return {"type": "rectangle", "to_world": mi.ScalarTransform4f(to_world), "emitter": emitter}


def render(scene, coat, led, depth, window):
    columns, rows = scene["width"] - 2, scene["height"] - 2
    half_mm = 0.5 * columns * scene["mm_per_px"][0]
    # The film's x axis runs to the camera's left: seen from above, that is +x with y down.
    # A film of width 2 and of the same pixels down; its x axis runs to the camera's left.
    to_world = np.diag([-half_mm, -half_mm, -1, 1.0])
    to_world[2, 3] = scene["window_mm"] - 0.01
    parts = {
        "type": "scene",
        "led": panel(led, scene),
        "integrator": {"type": "path", "max_depth": depth, "rr_depth": 100},
        "sensor": {
            "type": "orthographic",
            "to_world": mi.ScalarTransform4f(to_world),
            "near_clip": 1e-3,
            "film": {
                "type": "hdrfilm",
                "width": columns,
                "height": rows,
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "multijitter", "sample_count": PATHS, "seed": 0},
        },
        "coat": {
            "type": "ply",
            "filename": str(coat),
            "bsdf": {
                "type": "twosided",
                "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": scene["albedo"]}},
            },
        },
    }
    if window:
        to_world = np.diag([*walls(scene), 1, 1.0])
        to_world[2, 3] = scene["window_mm"]
        parts["window"] = {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f(to_world),
            # The normal points to the air.
            "bsdf": {"type": "dielectric", "int_ior": scene["refractive_index"], "ext_ior": 1.0},
        }
    return np.array(mi.render(mi.load_dict(parts)))[:, :, :3].astype(float)


def main():
    scene = json.loads(Path(sys.argv[1]).read_text())
    with tempfile.TemporaryDirectory() as folder:
        coat = Path(folder) / "coat.ply"
        write_coat(coat, scene)
        # One LED at a time: paths need not choose one. Equal seeds: what images have in common cancels.
        of_all = [[render(scene, coat, led, *what) for what in [(2, False), (3, False), (3, True)]] for led in scene["leds"]]
        direct, with_bounce, with_window = (sum(images) for images in zip(*of_all, strict=True))
    # An LED seen by the camera itself is none of the coat's light: none is in view.
    ways = {"direct": direct, "mirrored": with_window - with_bounce, "bounced": with_bounce - direct}
    Path(sys.argv[2]).write_text(json.dumps({name: light.reshape(-1, 3).tolist() for name, light in ways.items()}))


if __name__ == "__main__":
    main()
