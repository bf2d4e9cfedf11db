"""Response models for maps and objects. World frame: z up, metres."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from helios_gateway.api_models import RobotPose, Vector2, Vector3


class ObjectInstance(BaseModel):
    """One instance of the object map (paper section 3.1.3)."""

    model_config = ConfigDict(populate_by_name=True)

    id: int = Field(description="identifier of the instance, constant while the instance exists")
    class_name: str = Field(
        validation_alias="class_name", serialization_alias="class", examples=["mug"]
    )
    center_m: Vector3 = Field(description="centre of the bounding box in the world frame, metres")
    size_m: Vector3 = Field(
        description="size of the bounding box along the axes of the world frame, metres"
    )
    score: float | None = Field(description="score Ψ = S − α_cs U, eq. 7")
    class_score: float | None = Field(description="class score S")
    uncertainty: float | None = Field(description="uncertainty U")
    views: int = Field(description="number of distinct viewpoints fused")
    gaussians: int = Field(description="number of Gaussians of the instance")
    probabilities: dict[str, float | None] = Field(
        description="mean expected probability of each class, by class name",
        examples=[{"mug": 0.8, "other": 0.2}],
    )
    detection_rate: float | None = Field(
        description="share of the instance's views in which it was detected as its class"
    )
    image_text_nats: float | None = Field(
        description="log-likelihood ratio of the class by the image-text scores of the views that "
        "show the instance, nats; the scores contain it. null: the scorer does not rate the class"
    )
    outline_m: list[Vector2] = Field(
        description="convex hull of the projection to the ground, in the world frame, metres"
    )
    relocalisation: Literal["relocalised"] | None = Field(
        description="relocalised: of a stored map whose place was found since the start; null: "
        "any other object of the present map"
    )


class StoredObject(BaseModel):
    """Object of a stored map that is not in use, because its place is not confirmed."""

    model_config = ConfigDict(populate_by_name=True)

    class_name: str = Field(
        validation_alias="class_name", serialization_alias="class", examples=["mug"]
    )
    relocalisation: Literal["tentative", "unknown"] = Field(
        description="tentative: its place was found once; unknown: it has no place. The robot "
        "drives to neither"
    )
    center_m: Vector3 = Field(
        description="centre of the bounding box in the world frame, metres; null while unknown"
    )
    size_m: Vector3 = Field(description="size of the bounding box in its own map, metres")
    score: float | None = Field(description="score Ψ when the map was saved")
    views: int = Field(description="number of distinct viewpoints fused")


class Relocalisation(BaseModel):
    """Search for the place of a stored map in the world frame."""

    state: Literal["tentative", "unknown"] = Field(
        description="tentative: one alignment passed; unknown: none has"
    )
    attempts: int = Field(description="number of alignments so far")
    reason: str = Field(description="reason why the last alignment did not pass; empty: it did")
    overlap_m: float | None = Field(
        description="length of walls and furniture compared in the last alignment, metres"
    )
    agreement: float | None = Field(description="share of it that agrees, 0 to 1")
    contradiction: float | None = Field(
        description="share of the free floor that is inside stored obstacles, 0 to 1"
    )
    ratio: float | None = Field(
        description="score of the second-best place in shares of the best, 0 to 1"
    )


class ObjectList(BaseModel):
    objects: list[ObjectInstance] = Field(
        description="all instances, or those that match the query"
    )
    version: int = Field(description="version of the object map")
    gaussians: int = Field(description="number of Gaussians in the whole object map")
    stored: list[StoredObject] = Field(
        description="objects of a stored map that is not in use, or those that match the query"
    )
    relocalisation: Relocalisation | None = Field(
        description="search for the place of that map; null without one"
    )


class ScoreSample(BaseModel):
    """Estimate of an object after a view that added evidence."""

    stamp_s: float = Field(description="time of the view on the robot's clock")
    views: float | None = Field(description="number of distinct viewpoints fused until then")
    score: float | None = Field(description="score Ψ after the view")
    class_score: float | None = Field(description="class score S after the view")


class ObjectDetail(BaseModel):
    """One object with all figures, the history of its score, and its upright box."""

    object: ObjectInstance = Field(description="object as returned by `/v1/objects`")
    history: list[ScoreSample] = Field(description="score history, oldest first; thinned if long")
    box_center_m: Vector3 = Field(
        description="centre of the smallest upright box in the world frame, metres"
    )
    box_size_m: Vector3 = Field(
        description="size of the upright box along its own axes, metres; x is the narrow side"
    )
    box_yaw_rad: float | None = Field(
        description="direction of the upright box's x axis, along which a gripper closes"
    )


class Frontier(BaseModel):
    """Border between free floor that the search has explored and floor that it has not."""

    id: int = Field(description="identifier of the frontier, constant while the frontier persists")
    center_m: Vector2 = Field(
        description="point on the frontier near its middle, in the world frame, metres"
    )
    size_m: float | None = Field(description="length of the frontier")
    reachable: bool = Field(description="true if the robot can come near the frontier")
    values: dict[str, float | None] = Field(
        description="value of each value layer near the frontier, by name of the layer",
        examples=[{"pick": 0.31, "place": 0.12}],
    )


class FrontierList(BaseModel):
    version: int = Field(description="version of the 2D map")
    frontiers: list[Frontier] = Field(description="frontiers, in no particular order")


class MapLayer(BaseModel):
    name: str = Field(examples=["pick"])
    max_value: float = Field(
        description="value that appears as 255 in the blue channel of `/v1/map/cells.png`"
    )


class MapInfo(BaseModel):
    """2D map without its cell arrays."""

    version: int = Field(description="version of the 2D map; rises with every change")
    map_id: str = Field(
        description="identifier of the map; changes when a new map begins (new world, reset, "
        "load) or map2d restarts"
    )
    context_id: str = Field(description="identifier of the search context that the map serves")
    cell_m: float = Field(description="side length of a cell")
    origin_m: Vector2 = Field(
        description="corner of the lower left cell in the world frame, metres"
    )
    width_cells: int = Field(description="number of cells along x")
    height_cells: int = Field(description="number of cells along y")
    explored_m2: float | None = Field(description="area of all known cells")
    occupied_m2: float | None = Field(description="area of the occupied cells")
    layers: list[MapLayer] = Field(description="value layers of the map")
    robot: RobotPose | None = Field(description="pose of the robot; null: unknown")
    trajectory_m: list[Vector2] = Field(
        description="past positions of the robot in the world frame, metres, oldest first"
    )
    trajectory_starts: list[int] = Field(
        default=[], description="indices of trajectory points after a gap, to which no line leads"
    )


class LoadedMaps(BaseModel):
    """Content of the maps after a map file was loaded."""

    known_m2: float | None = Field(description="area of all known cells of the 2D map")
    occupied_m2: float | None = Field(description="area of the occupied cells of the 2D map")
    views: int = Field(description="number of past views that can be searched")
    objects: int = Field(description="number of instances in the file")
    gaussians: int = Field(description="number of Gaussians in the file")
    stored: bool = Field(
        description="true: the file is of another world, and is not in use until the robot has "
        "found its place in it; false: its maps replaced the present ones"
    )


class ResetMaps(BaseModel):
    """Maps that the request emptied."""

    reset: list[Literal["objects", "occupancy"]] = Field(description="maps that were emptied")


class SeenView(BaseModel):
    """Past view that matches a query."""

    score: float | None = Field(description="score of the view for the query, 0 to 1")
    class_name: str = Field(
        validation_alias="class_name",
        serialization_alias="class",
        description="detected class that matches the query, to which the score belongs; "
        "empty: the scorer's model rated the view",
    )
    center_m: Vector2 = Field(
        description="position of the detection, else most likely position of the object in "
        "the view; world frame, metres"
    )
    camera: RobotPose | None = Field(description="position and viewing direction of the camera")
    stamp_s: float = Field(description="time of the view on the robot's clock")
    frame_id: str = Field(description="identifier of the keyframe")
    jpeg_base64: str = Field(description="small JPEG of the view, base64-encoded")


class SeenAnswer(BaseModel):
    """Objects of the queried name, and past views that match the query."""

    prompt: str = Field(description="search text of the request")
    objects: list[ObjectInstance] = Field(
        description="matching objects, highest score first; image of each: "
        "`/v1/objects/{id}/view.png`"
    )
    stored: list[StoredObject] = Field(
        description="matching objects of a stored map that is not in use"
    )
    views: list[SeenView] = Field(description="matching past views of different places, best first")
    views_asked: int = Field(description="number of stored views that were searched")
    views_note: str = Field(
        description="reason why past views were not searched, or only by class name; empty: "
        "the scorer's model searched them"
    )


class ViewList(BaseModel):
    """Past views of one object."""

    views: list[SeenView] = Field(description="past views of the object, best first")
    views_note: str = Field(
        description="reason why past views were not searched, or only by class name, as in "
        "`/v1/seen`"
    )


class MapChange(BaseModel):
    """Event: the 2D map or the object map has changed."""

    map2d: int = Field(description="counter that rises when the 2D map changes")
    objects: int = Field(description="counter that rises when the object map changes")
