"""Response models for maps and objects. World frame: z up, metres."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from helios_gateway.api_models import RobotPose, Vector2, Vector3


class ObjectInstance(BaseModel):
    """One instance of the object map (paper section 3.1.3)."""

    model_config = ConfigDict(populate_by_name=True)

    id: int = Field(description="stays while the instance lives")
    class_name: str = Field(
        validation_alias="class_name", serialization_alias="class", examples=["mug"]
    )
    center_m: Vector3 = Field(description="middle of its box")
    size_m: Vector3 = Field(description="along the axes of the world")
    score: float | None = Field(description="Ψ, eq. 7: class score less uncertainty")
    class_score: float | None = Field(description="S")
    uncertainty: float | None = Field(description="U")
    views: int = Field(description="distinct viewpoints fused")
    gaussians: int = Field(description="Gaussians that it consists of")
    probabilities: dict[str, float | None] = Field(
        description="class → mean expected probability", examples=[{"mug": 0.8, "other": 0.2}]
    )
    detection_rate: float | None = Field(
        description="share of its views in which it was detected as its class"
    )
    outline_m: list[Vector2] = Field(description="hull of its projection to the ground")


class ObjectList(BaseModel):
    objects: list[ObjectInstance] = Field(description="all instances, or those that were asked for")
    version: int = Field(description="of the object map")
    gaussians: int = Field(description="of the whole map")


class ScoreSample(BaseModel):
    """Estimate of an object after a view that added evidence."""

    stamp_s: float = Field(description="the robot's clock")
    views: float | None = Field(description="distinct viewpoints fused until then")
    score: float | None = Field(description="Ψ")
    class_score: float | None = Field(description="S")


class ObjectDetail(BaseModel):
    """One object with all figures, the history of its score, and its upright box."""

    object: ObjectInstance = Field(description="as in `/v1/objects`")
    history: list[ScoreSample] = Field(description="oldest first; long ones are thinned")
    box_center_m: Vector3 = Field(description="of the upright box, turned to be smallest")
    box_size_m: Vector3 = Field(description="along its own axes; x is the narrow side")
    box_yaw_rad: float | None = Field(description="of its x axis: where a gripper closes")


class Frontier(BaseModel):
    """Border between free floor that the search has explored and floor that it has not."""

    id: int = Field(description="stays while the frontier lives")
    center_m: Vector2 = Field(description="a point of the border, near its middle")
    size_m: float | None = Field(description="length of the border")
    reachable: bool = Field(description="the robot can come near")
    values: dict[str, float | None] = Field(
        description="of each value layer near it", examples=[{"pick": 0.31, "place": 0.12}]
    )


class FrontierList(BaseModel):
    version: int = Field(description="of the 2D map")
    frontiers: list[Frontier] = Field(description="in no order")


class MapLayer(BaseModel):
    name: str = Field(examples=["pick"])
    max_value: float = Field(description="the value that 255 stands for in the cells picture")


class MapInfo(BaseModel):
    """2D map without its cell arrays."""

    version: int = Field(description="rises with each change")
    map_id: str = Field(
        description="another one than before: a new map has begun (new world, reset, load), or "
        "map2d was restarted"
    )
    context_id: str = Field(description="the search context that it serves")
    cell_m: float = Field(description="side of a cell")
    origin_m: Vector2 = Field(description="corner of the lower left cell")
    width_cells: int = Field(description="along x")
    height_cells: int = Field(description="along y")
    explored_m2: float | None = Field(description="ground seen since the search began")
    occupied_m2: float | None = Field(description="ground that obstacles cover")
    layers: list[MapLayer] = Field(description="the value layers")
    robot: RobotPose | None = Field(description="null: not known yet")
    trajectory_m: list[Vector2] = Field(description="where the robot was, oldest first")
    trajectory_starts: list[int] = Field(
        default=[], description="points that the robot came to unseen: no line leads there"
    )


class LoadedMaps(BaseModel):
    """Content of the maps after a map file was loaded."""

    known_m2: float | None = Field(description="ground that the 2D map knows")
    occupied_m2: float | None = Field(description="ground that obstacles cover")
    views: int = Field(description="past views that can be asked about")
    objects: int = Field(description="instances in the object map")
    gaussians: int = Field(description="Gaussians in the object map")


class ResetMaps(BaseModel):
    """Maps that the request emptied."""

    reset: list[Literal["objects", "occupancy"]] = Field(description="which maps were forgotten")


class SeenView(BaseModel):
    """Past view that matches a query."""

    score: float | None = Field(description="how well it fits, 0 to 1")
    class_name: str = Field(
        validation_alias="class_name",
        serialization_alias="class",
        description="what the detector named in it, with that score; empty: the scorer's model "
        "was asked",
    )
    center_m: Vector2 = Field(description="where that was; else the middle of what it saw")
    camera: RobotPose | None = Field(description="where the camera stood, and its direction")
    stamp_s: float = Field(description="the robot's clock")
    frame_id: str = Field(description="names the keyframe")
    jpeg_base64: str = Field(description="a small picture of it")


class SeenAnswer(BaseModel):
    """Objects of the queried name, and past views that match the query."""

    prompt: str = Field(description="what was asked for")
    objects: list[ObjectInstance] = Field(description="surest first; pictures: /view.png of each")
    views: list[SeenView] = Field(description="best first, of different places")
    views_asked: int = Field(description="of all that were kept")
    views_note: str = Field(
        description="why past views were not asked, or by names alone; empty: by the model"
    )


class ViewList(BaseModel):
    """Past views of one object."""

    views: list[SeenView] = Field(description="best first")
    views_note: str = Field(description="as of /v1/seen")


class MapChange(BaseModel):
    """Event: the 2D map or the object map has changed."""

    map2d: int = Field(description="version of the 2D map")
    objects: int = Field(description="version of the object map")
