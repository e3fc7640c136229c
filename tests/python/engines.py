"""The same scene in every physics engine that has an adapter: a pad on a link of a turned finger, and an object whose collision shapes
and centre of mass lie beside its origin. Engines read both from URDF."""

import numpy as np

import gelsim
from gelsim.adapters import Transform, shapes

# Engines' names, which are those of the adapters, and the modules that are theirs.
MODULES = {"pybullet": "pybullet", "drake": "pydrake", "sapien": "sapien", "genesis": "genesis", "newton": "newton"}

WEDGE = np.array([(-2, -1, 0), (2.5, -1, 0.3), (1, 2, 0.1), (-1.5, 1.2, 0.6), (0.5, 0.2, 2)], float)
WEDGE_FACES = np.array([(0, 2, 1), (0, 3, 2), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)])
WEDGE_SCALE = (1, 0.75, 2)
# Each collision shape: what URDF says of it, its triangles in mm, and where it is in its body: mm, and turns about x, y, z.
OBJECTS = {
    "ball": [('<sphere radius="0.004"/>', shapes.sphere(4), (3, -2, 5), (0, 0, 0))],
    "block": [
        ('<box size="0.003 0.005 0.002"/>', shapes.box((1.5, 2.5, 1)), (4, -1, 2), (0.1, -0.15, 0.6)),
        ('<cylinder radius="0.0015" length="0.006"/>', shapes.cylinder(1.5, 3), (-2, 1, 2), (1.5, 0.1, 0.4)),
    ],
    "wedge": [
        (
            '<mesh filename="wedge.obj" scale="0.001 0.00075 0.002"/>',
            shapes.Shape(WEDGE * WEDGE_SCALE, WEDGE_FACES),
            (1, 2, 3),
            (0.05, 0.1, -0.7),
        )
    ],
}
MASS = """<inertial><origin xyz="0.002 0.003 -0.004" rpy="0.3 0.2 0.5"/><mass value="0.1"/>
<inertia ixx="1e-5" iyy="1.2e-5" izz="1.5e-5" ixy="0" ixz="0" iyz="0"/></inertial>"""
FINGER = f"""<robot name="finger"><link name="root">{MASS}</link><link name="tip">{MASS}</link><joint name="holds" type="fixed">
<parent link="root"/><child link="tip"/><origin xyz="0.05 -0.02 0.03" rpy="0.4 -0.3 1.1"/></joint></robot>"""


def turn(x, y, z):
    """The rotation by roll, pitch and yaw, as URDF has it."""
    (a, b, c), (d, e, f) = np.cos([x, y, z]), np.sin([x, y, z])
    about_x, about_y = np.array([(1, 0, 0), (0, a, -d), (0, d, a)]), np.array([(b, 0, e), (0, 1, 0), (-e, 0, b)])
    return np.array([(c, -f, 0), (f, c, 0), (0, 0, 1)]) @ about_y @ about_x


HERE = Transform(np.zeros(3), np.eye(3))
ROOT = Transform(np.array([0.3, -0.2, 0.5]), turn(0.7, -0.2, 2))
TIP = Transform(np.array([0.05, -0.02, 0.03]), turn(0.4, -0.3, 1.1))
# Where the pad's frame is in the link.
OFFSET = Transform(np.array([0.004, 0.001, 0.012]), turn(-0.2, 0.9, 0.3))
PAD = Transform(ROOT.position_m + ROOT.rotation @ (TIP.position_m + TIP.rotation @ OFFSET.position_m),
                ROOT.rotation @ TIP.rotation @ OFFSET.rotation)  # fmt: skip
TURN = turn(0.06, -0.04, 0.8)


def in_body(name):
    """The corners of an object's triangles in its body, mm, and the triangles."""
    return shapes.joined([shapes.Shape(its.vertices @ turn(*by).T + at, its.faces) for _, its, at, by in OBJECTS[name]])


def in_pad(name, depth_mm, x_mm=0.0):
    """Where an object is in the pad's frame, mm, so that it is so deep."""
    corners = in_body(name).vertices @ TURN.T
    low, high = corners.min(axis=0), corners.max(axis=0)
    return np.array([x_mm - 0.5 * (low[0] + high[0]), 0.4 - 0.5 * (low[1] + high[1]), -low[2] - depth_mm])


def in_world(at_mm):
    """Where an object is in the world that is there in the pad's frame."""
    return Transform(PAD.position_m + PAD.rotation @ at_mm * 1e-3, PAD.rotation @ TURN)


# A block of 100 g and 8 mm beside its body's origin, which falls on a pad at the world's origin.
BESIDE_M, HALF_M, MASS_KG, FALL = [0.01, 0.004, 0.0], [0.004] * 3, 0.1, Transform(np.array([-0.01, -0.004, 0.0045]), np.eye(3))
BLOCK = """<robot name="block"><link name="block"><inertial><origin xyz="0.01 0.004 0"/><mass value="0.1"/>
<inertia ixx="1.1e-6" iyy="1.1e-6" izz="1.1e-6" ixy="0" ixz="0" iyz="0"/></inertial><collision><origin xyz="0.01 0.004 0"/>
<geometry><box size="0.008 0.008 0.008"/></geometry></collision></link></robot>"""

CAPSULE, ELLIPSOID, SOLID = shapes.capsule(2, 3), shapes.ellipsoid((1, 2, 3)), shapes.Shape(WEDGE, WEDGE_FACES)


def wxyz(turned):
    x, y, z, w = turned.xyzw.tolist()
    return [w, x, y, z]


def write(folder, name):
    """The files of the finger and of an object; their paths."""
    found = [
        f'<collision><origin xyz="{" ".join(str(1e-3 * part) for part in at)}" rpy="{" ".join(map(str, by))}"/>'
        f"<geometry>{text}</geometry></collision>"
        for text, _, at, by in OBJECTS[name]
    ]
    corners = [" ".join(map(str, ["v", *corner])) for corner in WEDGE]
    faces = [" ".join(map(str, ["f", *(face + 1)])) for face in WEDGE_FACES]
    (folder / "wedge.obj").write_text("\n".join(corners + faces) + "\n")
    (folder / "finger.urdf").write_text(FINGER)
    (folder / f"{name}.urdf").write_text(f'<robot name="{name}"><link name="{name}">{MASS}{"".join(found)}</link></robot>')
    return str(folder / "finger.urdf"), str(folder / f"{name}.urdf")


class Bullet:
    def __init__(self, folder, name):
        import pybullet

        from gelsim.adapters import pybullet as adapter

        finger, body = write(folder, name)
        self.bullet, self.adapter = pybullet, adapter
        self.client = pybullet.connect(pybullet.DIRECT)
        flags = pybullet.URDF_USE_IMPLICIT_CYLINDER
        self.finger = pybullet.loadURDF(finger, ROOT.position_m, ROOT.xyzw, useFixedBase=True, physicsClientId=self.client)
        self.body = pybullet.loadURDF(body, flags=flags, physicsClientId=self.client)
        self.shape = adapter.shape_of(self.body, client=self.client)

    def move(self, at):
        # The base's place is that of its centre of mass.
        centre = at @ Transform(np.array([0.002, 0.003, -0.004]), turn(0.3, 0.2, 0.5))
        self.bullet.resetBasePositionAndOrientation(self.body, centre.position_m, centre.xyzw, physicsClientId=self.client)

    def places(self):
        place = self.adapter.place_of
        return place((self.finger, 0), client=self.client), place(self.body, client=self.client)

    def kinds(self):
        """Bodies of one shape and what it should be, by names of kinds; then what makes each of those that are refused."""
        wedge = 1e-3 * WEDGE

        def made(kind, **sizes):
            number = self.bullet.createCollisionShape(getattr(self.bullet, kind), physicsClientId=self.client, **sizes)
            body = self.bullet.createMultiBody(0.0, number, physicsClientId=self.client)
            return self.adapter.shape_of(body, client=self.client)

        yield {
            "GEOM_CAPSULE": (made("GEOM_CAPSULE", radius=0.002, height=0.006), CAPSULE),
            "GEOM_MESH": (made("GEOM_MESH", vertices=wedge.tolist()), SOLID),
        }
        concave = {"vertices": wedge.tolist(), "indices": WEDGE_FACES.ravel().tolist()}
        yield {"GEOM_PLANE": lambda: made("GEOM_PLANE"), "GEOM_MESH": lambda: made("GEOM_MESH", **concave)}

    @staticmethod
    def falling(folder, step_s):
        """A block: its shape, where it is, the point that forces are about, and what pushes it for a step."""
        import pybullet

        from gelsim.adapters import pybullet as adapter

        (folder / "block.urdf").write_text(BLOCK)
        client = pybullet.connect(pybullet.DIRECT)
        of = {"physicsClientId": client}
        pybullet.setGravity(0, 0, -9.81, **of)
        pybullet.setTimeStep(step_s, **of)
        body = pybullet.loadURDF(str(folder / "block.urdf"), **of)
        centre = lambda: pybullet.getBasePositionAndOrientation(body, **of)[0]
        pybullet.resetBasePositionAndOrientation(body, [0, 0, 0.0045], [0, 0, 0, 1], **of)

        def push(force, torque):
            pybullet.applyExternalForce(body, -1, force, centre(), pybullet.WORLD_FRAME, **of)
            pybullet.applyExternalTorque(body, -1, torque, pybullet.WORLD_FRAME, **of)
            pybullet.stepSimulation(**of)

        return adapter.shape_of(body, client=client), lambda: adapter.place_of(body, client=client), centre, push


class Drake:
    def __init__(self, folder, name):
        from pydrake.math import RigidTransform, RotationMatrix
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
        from pydrake.systems.framework import DiagramBuilder

        from gelsim.adapters import drake as adapter

        self.adapter, self.folder = adapter, folder
        self.pose = lambda at: RigidTransform(RotationMatrix(at.rotation), at.position_m)
        builder = DiagramBuilder()
        self.plant, _ = AddMultibodyPlantSceneGraph(builder, 0.001)
        Parser(self.plant).AddModels(write(folder, name)[0])
        Parser(self.plant).AddModels(write(folder, name)[1])
        self.plant.Finalize()
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()
        self.body, self.tip = self.plant.GetBodyByName(name), self.plant.GetFrameByName("tip")
        own = self.plant.GetMyMutableContextFromRoot(self.context)
        self.set = lambda body, at: self.plant.SetFreeBodyPose(own, body, self.pose(at))
        self.set(self.plant.GetBodyByName("root"), ROOT)
        self.shape = adapter.shape_of(self.body, self.context)

    def move(self, at):
        self.set(self.body, at)

    def places(self):
        return self.adapter.place_of(self.tip, self.context), self.adapter.place_of(self.body, self.context)

    def kinds(self):
        from pydrake.geometry import Capsule, Convex, Ellipsoid, HalfSpace
        from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
        from pydrake.multibody.tree import SpatialInertia
        from pydrake.systems.framework import DiagramBuilder

        builder = DiagramBuilder()
        plant, _ = AddMultibodyPlantSceneGraph(builder, 0.001)
        bodies = {}
        hull = Convex(str(self.folder / "wedge.obj"), scale=1e-3)
        for each in (Capsule(0.002, 0.006), Ellipsoid(0.001, 0.002, 0.003), hull, HalfSpace()):
            kind = type(each).__name__
            bodies[kind] = plant.AddRigidBody(kind, SpatialInertia.SolidSphereWithMass(1.0, 0.1))
            plant.RegisterCollisionGeometry(bodies[kind], self.pose(HERE), each, kind, CoulombFriction(1.0, 1.0))
        plant.Finalize()
        diagram = builder.Build()
        context = diagram.CreateDefaultContext()
        expected = {"Capsule": CAPSULE, "Ellipsoid": ELLIPSOID, "Convex": SOLID}
        yield {kind: (self.adapter.shape_of(bodies[kind], context), shape) for kind, shape in expected.items()}
        yield {"HalfSpace": lambda: self.adapter.shape_of(bodies["HalfSpace"], context)}

    @staticmethod
    def falling(folder, step_s):
        from pydrake.math import RigidTransform
        from pydrake.multibody.math import SpatialForce
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, ExternallyAppliedSpatialForce
        from pydrake.systems.analysis import Simulator
        from pydrake.systems.framework import DiagramBuilder

        from gelsim.adapters import drake as adapter

        (folder / "block.urdf").write_text(BLOCK)
        builder = DiagramBuilder()
        plant, _ = AddMultibodyPlantSceneGraph(builder, step_s)
        Parser(plant).AddModels(str(folder / "block.urdf"))
        plant.Finalize()
        builder.ExportInput(plant.get_applied_spatial_force_input_port(), "pushes")
        simulator = Simulator(builder.Build())
        context, body = simulator.get_mutable_context(), plant.GetBodyByName("block")
        plant.SetFreeBodyPose(plant.GetMyMutableContextFromRoot(context), body, RigidTransform(FALL.position_m))
        where = lambda: adapter.place_of(body, context)

        def push(force, torque):
            acting = ExternallyAppliedSpatialForce()
            acting.body_index, acting.p_BoBq_B, acting.F_Bq_W = body.index(), [0, 0, 0], SpatialForce(torque, force)
            simulator.get_system().GetInputPort("pushes").FixValue(context, [acting])
            simulator.AdvanceTo(context.get_time() + step_s)

        return adapter.shape_of(body, context), where, lambda: where().position_m, push


class Sapien:
    def __init__(self, folder, name):
        import sapien

        from gelsim.adapters import sapien as adapter

        self.adapter, self.folder = adapter, folder
        self.scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
        self.pose = lambda at: sapien.Pose(at.position_m, wxyz(at))
        loader = self.scene.create_urdf_loader()
        loader.fix_root_link = False
        finger, body = write(folder, name)
        self.finger, (_, (self.body,)) = loader.load(finger), loader.load_multiple(body)
        self.finger.set_root_pose(self.pose(ROOT))
        self.shape = adapter.shape_of(self.body)

    def move(self, at):
        self.body.set_pose(self.pose(at))

    def places(self):
        (tip,) = (link for link in self.finger.links if link.name == "tip")
        return self.adapter.place_of(tip), self.adapter.place_of(self.body)

    def kinds(self):
        capsule = self.scene.create_actor_builder()
        capsule.add_capsule_collision(radius=0.002, half_length=0.003)
        mesh = self.scene.create_actor_builder()
        mesh.add_nonconvex_collision_from_file(str(self.folder / "wedge.obj"), scale=[1e-3] * 3)
        along_x = shapes.Shape(CAPSULE.vertices[:, [2, 0, 1]], CAPSULE.faces)
        found = {"Capsule": (capsule, along_x), "TriangleMesh": (mesh, SOLID)}
        yield {kind: (self.adapter.shape_of(builder.build_kinematic()), shape) for kind, (builder, shape) in found.items()}
        yield {"Plane": lambda: self.adapter.shape_of(self.scene.add_ground(0.0, render=False))}

    @staticmethod
    def falling(folder, step_s):
        import sapien

        from gelsim.adapters import sapien as adapter

        scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
        scene.set_timestep(step_s)
        builder = scene.create_actor_builder()
        builder.add_box_collision(sapien.Pose(BESIDE_M), HALF_M, density=MASS_KG / 0.008**3)
        builder.set_initial_pose(sapien.Pose(FALL.position_m))
        body = builder.build("block")
        component = body.find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)

        def push(force, torque):
            component.add_force_torque(force, torque)
            scene.step()

        centre = lambda: (body.pose * component.cmass_local_pose).p
        return adapter.shape_of(body), lambda: adapter.place_of(body), centre, push


class Genesis:
    def __init__(self, folder, name):
        import genesis

        from gelsim.adapters import genesis as adapter

        if not genesis._initialized:
            genesis.init(backend=genesis.cpu, logging_level="error")
        finger, body = write(folder, name)
        self.folder = folder
        self.adapter, self.scene = adapter, genesis.Scene(show_viewer=False)
        place = {"pos": ROOT.position_m.tolist(), "quat": wxyz(ROOT)}
        urdf = genesis.morphs.URDF(file=finger, fixed=True, merge_fixed_links=False, **place)
        self.finger = self.scene.add_entity(urdf)
        self.body = self.scene.add_entity(genesis.morphs.URDF(file=body))
        self.scene.build()
        self.shape = adapter.shape_of(self.body)

    def move(self, at):
        self.body.set_pos(at.position_m.tolist())
        self.body.set_quat(wxyz(at))

    def places(self):
        return self.adapter.place_of(self.finger.get_link("tip")), self.adapter.place_of(self.body)

    def kinds(self):
        import genesis

        (self.folder / "more.xml").write_text("""<mujoco><worldbody>
<body name="capsule"><freejoint/><geom type="capsule" size="0.002 0.003"/></body>
<body name="ellipsoid" pos="1 0 0"><freejoint/><geom type="ellipsoid" size="0.001 0.002 0.003"/></body>
</worldbody></mujoco>""")
        scene = genesis.Scene(show_viewer=False)
        plane = scene.add_entity(genesis.morphs.Plane())
        more = scene.add_entity(genesis.morphs.MJCF(file=str(self.folder / "more.xml")))
        scene.build()
        expected = {"capsule": CAPSULE, "ellipsoid": ELLIPSOID}
        yield {kind: (self.adapter.shape_of(more.get_link(kind)), shape) for kind, shape in expected.items()}
        yield {"PLANE": lambda: self.adapter.shape_of(plane), "'capsule'": lambda: self.adapter.shape_of(more)}

    @staticmethod
    def falling(folder, step_s):
        import genesis

        from gelsim.adapters import genesis as adapter

        (folder / "block.urdf").write_text(BLOCK)
        if not genesis._initialized:
            genesis.init(backend=genesis.cpu, logging_level="error")
        scene = genesis.Scene(sim_options=genesis.options.SimOptions(dt=step_s), show_viewer=False)
        body = scene.add_entity(genesis.morphs.URDF(file=str(folder / "block.urdf"), pos=FALL.position_m.tolist()))
        scene.build()
        where = lambda: adapter.place_of(body)

        def push(force, torque):
            body.base_link.apply_external_wrench(force, torque, pos=where().position_m)
            scene.step()

        return adapter.shape_of(body), where, lambda: where().position_m, push


class Newton:
    def __init__(self, folder, name):
        import newton
        import warp

        from gelsim.adapters import newton as adapter

        finger, body = write(folder, name)
        self.adapter, builder = adapter, newton.ModelBuilder()
        place = warp.transform(ROOT.position_m.tolist(), warp.quat(ROOT.xyzw.tolist()))
        builder.add_urdf(finger, xform=place, floating=False)
        builder.add_urdf(body, floating=True)
        self.model = builder.finalize(device="cpu")
        self.state = self.model.state()
        newton.eval_fk(self.model, self.model.joint_q, self.model.joint_qd, self.state)
        number = {label.split("/")[-1]: index for index, label in enumerate(self.model.body_label)}
        self.tip, self.body = number["tip"], number[name]
        self.shape = adapter.shape_of(self.model, self.body)

    def move(self, at):
        rows = self.state.body_q.numpy()
        rows[self.body] = [*at.position_m, *at.xyzw]
        self.state.body_q.assign(rows)

    def places(self):
        return self.adapter.place_of(self.state, self.tip), self.adapter.place_of(self.state, self.body)

    def kinds(self):
        import newton

        builder, mesh = newton.ModelBuilder(), newton.Mesh(WEDGE, WEDGE_FACES.ravel())
        bodies = {kind: builder.add_body(mass=1.0) for kind in ("CAPSULE", "ELLIPSOID", "CONVEX_MESH", "CONE")}
        builder.add_shape_capsule(bodies["CAPSULE"], radius=0.002, half_height=0.003)
        builder.add_shape_ellipsoid(bodies["ELLIPSOID"], rx=0.001, ry=0.002, rz=0.003)
        builder.add_shape_convex_hull(bodies["CONVEX_MESH"], mesh=mesh, scale=(1e-3, 1e-3, 1e-3))
        builder.add_shape_cone(bodies["CONE"], radius=0.002, half_height=0.003)
        builder.add_ground_plane()
        model = builder.finalize(device="cpu")
        expected = {"CAPSULE": CAPSULE, "ELLIPSOID": ELLIPSOID, "CONVEX_MESH": SOLID}
        yield {kind: (self.adapter.shape_of(model, bodies[kind]), shape) for kind, shape in expected.items()}
        refused = {"CONE": bodies["CONE"], "PLANE": -1}
        yield {kind: lambda body=body: self.adapter.shape_of(model, body) for kind, body in refused.items()}

    @staticmethod
    def falling(folder, step_s):
        import newton
        import warp

        from gelsim.adapters import newton as adapter

        builder = newton.ModelBuilder()
        body = builder.add_body(xform=warp.transform(FALL.position_m.tolist(), warp.quat_identity()))
        size = dict(zip(("hx", "hy", "hz"), HALF_M))
        place = warp.transform(BESIDE_M, warp.quat_identity())
        builder.add_shape_box(body, xform=place, cfg=builder.ShapeConfig(density=MASS_KG / 0.008**3), **size)
        model = builder.finalize(device="cpu")
        solver, states, control = newton.solvers.SolverXPBD(model), [model.state(), model.state()], model.control()
        where = lambda: adapter.place_of(states[0], body)

        def push(force, torque):
            states[0].body_f.assign([[*force, *torque]])
            solver.step(states[0], states[1], control, None, step_s)
            states.reverse()

        centre = lambda: (where() @ Transform(model.body_com.numpy()[body], np.eye(3))).position_m
        return adapter.shape_of(model, body), where, centre, push


SCENES = {"pybullet": Bullet, "drake": Drake, "sapien": Sapien, "genesis": Genesis, "newton": Newton}
