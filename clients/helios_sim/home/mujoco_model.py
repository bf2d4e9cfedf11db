"""MuJoCo model of a home: named bodies, drawn meshes, collision primitives, lights.

Geom groups: 0 structure, 1 ceiling, 2 furniture and objects (all drawn), 3 collision geoms.
"""

import math
from collections.abc import Iterable

import numpy as np

from helios_sim.home import floor_plans, freespace, textures, wall_meshes
from helios_sim.home.home_types import (
    CollisionPrimitive,
    Doorway,
    Fixture,
    Material,
    Mesh,
    Picture,
    Receptacle,
    Room,
    RoomStyle,
    SceneObject,
    Visual,
)
from helios_sim.mujoco_library import mujoco

TIMESTEP_S = 0.004
GROUP_STRUCTURE, GROUP_CEILING, GROUP_FURNITURE, GROUP_COLLISION = range(4)

_GEOMS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
}


def structure_classes(rooms: tuple[Room, ...], doorways: tuple[Doorway, ...]) -> dict[str, str]:
    """Class of each structural body: floors, walls, ceiling, door frames."""
    classes = {"walls": "wall", "ceiling": "ceiling"}
    classes |= {f"floor_{room.index}": "floor" for room in rooms}
    classes |= {f"wall_{room.index}": "wall" for room in rooms}
    classes |= {f"doorway_{k}": "door frame" for k in range(len(doorways))}
    return classes


def assemble(
    rooms: tuple[Room, ...],
    doorways: tuple[Doorway, ...],
    receptacles: tuple[Receptacle, ...],
    fixtures: tuple[Fixture, ...],
    objects: tuple[SceneObject, ...],
    styles: tuple[RoomStyle, ...],
    *,
    visuals: bool = True,
) -> mujoco.MjSpec:
    """MuJoCo model of a home without a robot."""
    model = ModelBuilder(visuals)
    bounds = floor_plans.bounds_of(rooms)
    blocked = [freespace.footprint(f) for f in (*receptacles, *fixtures) if casts_shade(f)]
    _add_structure(model, rooms, doorways, styles, blocked)
    model.contents(receptacles, fixtures, objects)
    return model.finish(bounds)


def _add_structure(
    model: "ModelBuilder",
    rooms: tuple[Room, ...],
    doorways: tuple[Doorway, ...],
    styles: tuple[RoomStyle, ...],
    blocked: list[freespace.Obstacle],
) -> None:
    """Add walls, floors, ceiling and door frames. blocked: what shades the floor."""
    bounds = floor_plans.bounds_of(rooms)
    pieces = floor_plans.wall_pieces(rooms, doorways)
    walls = model.body("walls")
    for k, piece in enumerate(pieces):
        half = (*piece.half_extent_xy, (piece.z1_m - piece.z0_m) / 2)
        center = (*piece.center_xy, (piece.z0_m + piece.z1_m) / 2)
        model.solid(walls, CollisionPrimitive("box", half, center), f"wall_piece_{k}")
    model.draw(walls, [wall_meshes.wall_caps(pieces)], GROUP_STRUCTURE)
    ceiling = model.body("ceiling")
    for room, style in zip(rooms, styles, strict=True):
        floor = model.body(f"floor_{room.index}")
        half_x, half_y = (room.x1 - room.x0) / 2, (room.y1 - room.y0) / 2
        center = (*room.center_xy, -0.05)
        model.solid(floor, CollisionPrimitive("box", (half_x, half_y, 0.05), center), "")
        paint = model.body(f"wall_{room.index}")
        if model.visuals:
            rng = np.random.default_rng([11, room.index, *_key(bounds)])
            picture = wall_meshes.floor_texture(rng, room, style, blocked)
            material = model.picture(f"floor_{room.index}", picture)
            model.mesh(floor, wall_meshes.floor_mesh(room), material, GROUP_STRUCTURE)
            model.draw(paint, wall_meshes.wall_visuals(room, doorways, style), GROUP_STRUCTURE)
            lid = Visual(wall_meshes.ceiling_mesh(room), wall_meshes.CEILING)
            model.draw(ceiling, [lid], GROUP_CEILING)
    for k, door in enumerate(doorways):
        threshold = Material(styles[door.rooms[0]].floor_rgb, "wood", 0.1)
        frame = model.body(f"doorway_{k}")
        if model.visuals:
            model.draw(frame, wall_meshes.doorway_visuals(door, threshold), GROUP_STRUCTURE)


def casts_shade(item: Receptacle | Fixture) -> bool:
    """True if the floor below a piece of furniture is dark."""
    return isinstance(item, Receptacle) or item.blocks


def _key(bounds: floor_plans.Rect) -> list[int]:
    return [round(1000 * (value + 10)) for value in bounds]


class ModelBuilder:
    """Builder of an `MjSpec`; equal materials and textures are added once."""

    def __init__(self, visuals: bool) -> None:
        self.visuals = visuals
        self.spec = mujoco.MjSpec()
        self._materials: dict[Material, str] = {}
        self._textures: dict[str, str] = {}
        self._meshes = 0

    def body(
        self, name: str, position: tuple[float, float, float] = (0, 0, 0), yaw_rad: float = 0.0
    ) -> mujoco.MjsBody:
        body = self.spec.worldbody.add_body(name=name, pos=list(position))
        body.quat = [math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)]
        return body

    def contents(
        self,
        receptacles: Iterable[Receptacle],
        fixtures: Iterable[Fixture],
        objects: Iterable[SceneObject],
    ) -> None:
        """Add all furniture and objects."""
        for item in (*receptacles, *fixtures):
            z = item.z_m if isinstance(item, Fixture) else 0.0
            body = self.body(item.name, (item.x, item.y, z), item.yaw_rad)
            # Fixtures at the ceiling are hidden together with it.
            self.draw(body, item.shape.visuals, GROUP_CEILING if z > 1.9 else GROUP_FURNITURE)
            for solid in item.shape.collision_primitives:
                self.solid(body, solid, "")
        for thing in objects:
            self.thing(thing)

    def thing(self, thing: SceneObject) -> None:
        """Add a free object; its mass is distributed over its solids by volume."""
        body = self.body(thing.name, thing.position_m, thing.yaw_rad)
        body.add_freejoint()
        shape = thing.shape
        self.draw(body, shape.visuals, GROUP_FURNITURE)
        volumes = [_volume(solid) for solid in shape.collision_primitives]
        for solid, volume in zip(shape.collision_primitives, volumes, strict=True):
            geom = self.solid(body, solid, "")
            geom.mass = shape.mass_kg * volume / sum(volumes)
            geom.condim = 6
            geom.friction = [0.8, 0.005, 0.002]

    def solid(self, body: mujoco.MjsBody, solid: CollisionPrimitive, name: str) -> mujoco.MjsGeom:
        """Add a collision geom."""
        geom = body.add_geom(type=_GEOMS[solid.kind])
        if name:
            geom.name = name
        geom.size = list(solid.half_extent)
        geom.pos = list(solid.center)
        geom.quat = list(solid.quat)
        geom.group = GROUP_COLLISION
        geom.rgba = [0.9, 0.3, 0.3, 0.4]
        return geom

    def draw(self, body: mujoco.MjsBody, visuals: Iterable[Visual], group: int) -> None:
        """Add drawn geoms without collision."""
        if self.visuals:
            for visual in visuals:
                repeat = _repeat_m(visual.material)
                scaled = Mesh(
                    visual.mesh.vertices,
                    visual.mesh.normals,
                    visual.mesh.uv / np.float32(repeat),
                    visual.mesh.faces,
                )
                self.mesh(body, scaled, self._material(visual.material), group)

    def mesh(self, body: mujoco.MjsBody, mesh: Mesh, material: str, group: int) -> None:
        """Add one drawn mesh."""
        name = f"mesh_{self._meshes}"
        self._meshes += 1
        asset = self.spec.add_mesh(name=name)
        asset.uservert = mesh.vertices.ravel().tolist()
        asset.usernormal = mesh.normals.ravel().tolist()
        asset.usertexcoord = mesh.uv.ravel().tolist()
        asset.userface = mesh.faces.ravel().tolist()
        asset.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=material)
        geom.contype, geom.conaffinity, geom.mass, geom.group = 0, 0, 0.0, group

    def _material(self, material: Material) -> str:
        if material not in self._materials:
            name = f"material_{len(self._materials)}"
            self._materials[material] = name
            asset = self.spec.add_material(name=name, rgba=[*material.rgb, 1.0])
            asset.specular, asset.shininess = material.specular, material.shininess
            asset.emission = material.emission
            if material.picture is not None:
                self._textured(asset, self._image(material.picture))
            elif material.texture:
                self._textured(asset, self._pattern(material.texture))
        return self._materials[material]

    def picture(self, name: str, image: np.ndarray) -> str:
        """Add a material that shows one image; return its name."""
        asset = self.spec.add_material(name=name, rgba=[1.0, 1.0, 1.0, 1.0])
        asset.specular, asset.shininess = 0.05, 0.1
        self._textured(asset, self._texture(name, image))
        return name

    def _pattern(self, pattern: str) -> str:
        if pattern not in self._textures:
            name = f"pattern_{pattern}"
            self._textures[pattern] = self._texture(name, textures.pattern(pattern))
        return self._textures[pattern]

    def _image(self, picture: Picture) -> str:
        name = f"picture_{picture.name}"
        if name not in self._textures:
            self._textures[name] = self._texture(name, picture.pixels)
        return name

    def _texture(self, name: str, image: np.ndarray) -> str:
        texture = self.spec.add_texture(
            name=name,
            type=mujoco.mjtTexture.mjTEXTURE_2D,
            width=image.shape[1],
            height=image.shape[0],
            nchannel=3,
        )
        texture.data = np.ascontiguousarray(image).tobytes()
        return name

    @staticmethod
    def _textured(asset: mujoco.MjsMaterial, texture: str) -> None:
        asset.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = texture

    def finish(self, bounds: floor_plans.Rect) -> mujoco.MjSpec:
        """Add options and lights; return the spec."""
        spec = self.spec
        if self.visuals:
            spec.add_texture(
                name="outside",
                type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
                builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
                rgb1=[0.93, 0.94, 0.95],
                rgb2=[0.93, 0.94, 0.95],
                width=16,
                height=96,
            )
        spec.modelname = "home"
        spec.option.timestep = TIMESTEP_S
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.visual.global_.offwidth, spec.visual.global_.offheight = 1280, 960
        spec.visual.quality.offsamples = 0
        # The extent (m) scales the clipping planes: with 10 m, znear and zfar are metres / 10.
        spec.stat.extent = 10.0
        spec.stat.center = [(bounds[0] + bounds[2]) / 2, (bounds[1] + bounds[3]) / 2, 1.0]
        spec.visual.map.znear, spec.visual.map.zfar = 0.003, 3.0
        head = spec.visual.headlight
        head.ambient, head.diffuse, head.specular = [0.50] * 3, [0.26] * 3, [0.06] * 3
        for direction, strength in (((0.35, 0.25, -1.0), 0.34), ((-0.6, -0.45, -0.5), 0.20)):
            light = spec.worldbody.add_light(pos=[0, 0, 4], dir=list(direction))
            light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
            light.castshadow = False
            light.diffuse, light.specular = [strength] * 3, [0.15] * 3
            light.ambient = [0.0] * 3
        return spec


def _repeat_m(material: Material) -> float:
    return textures.PATTERNS[material.texture][0] if material.texture else 1.0


def _volume(solid: CollisionPrimitive) -> float:
    a, b, c = solid.half_extent
    if solid.kind == "box":
        return 8 * a * b * c
    if solid.kind == "cylinder":
        return 2 * math.pi * a * a * b
    if solid.kind == "sphere":
        return 4 / 3 * math.pi * a**3
    return 4 / 3 * math.pi * a * b * c
