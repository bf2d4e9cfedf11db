"""Tools for the maps, past views and the camera."""

from __future__ import annotations

import base64
import json
from typing import Annotated

from mcp.server.mcpserver import Image
from mcp.types import CallToolResult, ContentBlock, ImageContent, TextContent

from helios_client.mcp_tools.answer_models import FoundObject, Map, Seen
from helios_client.mcp_tools.tool_decorator import READS, Tools, tool


class MapTools(Tools):
    """Tools for objects, past views, the 2D map and the camera."""

    @tool("List objects", READS)
    async def objects(
        self, class_name: str | None = None, min_score: float | None = None
    ) -> list[FoundObject]:
        """List the object instances of the object map: class, centre, size, score Ψ and number of
        views of each. Filter by class_name, or by the lowest score min_score."""
        found = await self.helios.objects(class_name, min_score)
        return [FoundObject(**one.raw) for one in found]

    @tool("Find where something was seen", READS)
    async def where_seen(self, prompt: str, limit: int = 3) -> Annotated[CallToolResult, Seen]:
        """Find where something was seen; describe it in any words. Returns objects of that name
        and at most limit matching past views, best first, each with its image."""
        found = await self.helios.seen(prompt, limit)
        views = [{k: v for k, v in one.raw.items() if k != "jpeg_base64"} for one in found.views]
        answer = found.raw | {"views": views}
        content: list[ContentBlock] = [TextContent(type="text", text=json.dumps(answer))]
        content += [_picture(view.jpeg) for view in found.views if view.jpeg]
        return CallToolResult(content=content, structured_content=answer)

    @tool("Get the 2D map", READS)
    async def map_info(self) -> Map:
        """Get the size and explored area of the 2D map, the robot's pose and trajectory, and the
        frontiers (borders between explored and unexplored floor) with their values."""
        info = dict(await self.helios.map_info())
        return Map.model_validate(info | {"frontiers": await self.helios.frontiers()})

    @tool("Get an image of the map", READS)
    async def map_picture(self, layer: str = "occupancy") -> Image:
        """Get an image of the map: occupancy, or a value layer such as pick or place."""
        what = layer if layer == "occupancy" else f"value/{layer}"
        return Image(data=await self.helios.picture(what), format="png")

    @tool("Get the camera image", READS)
    async def camera(self) -> Image:
        """Get the current camera image, with boxes around the detections."""
        return Image(data=await self.helios.camera(), format="jpeg")


def _picture(jpeg: bytes) -> ImageContent:
    data = base64.b64encode(jpeg).decode()
    return ImageContent(type="image", data=data, mime_type="image/jpeg")
