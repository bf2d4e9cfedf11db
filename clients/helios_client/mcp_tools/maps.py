"""Tools for what the robot knows of the home."""

from __future__ import annotations

import base64
import json
from typing import Annotated

from mcp.server.mcpserver import Image
from mcp.types import CallToolResult, ContentBlock, ImageContent, TextContent

from helios_client.mcp_tools.answer_models import FoundObject, Map, Seen
from helios_client.mcp_tools.tool_decorator import READS, Tools, tool


class MapTools(Tools):
    """Objects, past views, the 2D map and the camera."""

    @tool("List objects", READS)
    async def objects(
        self, class_name: str | None = None, min_score: float | None = None
    ) -> list[FoundObject]:
        """What is believed to be where: class, centre, size, score Ψ and views of each instance;
        only those of a class, or with a score from min_score on."""
        found = await self.helios.objects(class_name, min_score)
        return [FoundObject(**one.raw) for one in found]

    @tool("Where something was seen", READS)
    async def where_seen(self, prompt: str, limit: int = 3) -> Annotated[CallToolResult, Seen]:
        """Where something was seen, in any words: believed objects of that name, and past views
        that fit, the best first, each with its picture."""
        found = await self.helios.seen(prompt, limit)
        views = [{k: v for k, v in one.raw.items() if k != "jpeg_base64"} for one in found.views]
        answer = found.raw | {"views": views}
        content: list[ContentBlock] = [TextContent(type="text", text=json.dumps(answer))]
        content += [_picture(view.jpeg) for view in found.views if view.jpeg]
        return CallToolResult(content=content, structured_content=answer)

    @tool("The 2D map", READS)
    async def map_info(self) -> Map:
        """The 2D map's size and explored area, where the robot is and has walked, and the borders
        of what was seen with their values."""
        info = dict(await self.helios.map_info())
        return Map.model_validate(info | {"frontiers": await self.helios.frontiers()})

    @tool("Picture of the map", READS)
    async def map_picture(self, layer: str = "occupancy") -> Image:
        """A picture of the map: occupancy, or a value layer such as pick or place."""
        what = layer if layer == "occupancy" else f"value/{layer}"
        return Image(data=await self.helios.picture(what), format="png")

    @tool("Camera", READS)
    async def camera(self) -> Image:
        """What the robot sees now, with boxes around what it detects."""
        return Image(data=await self.helios.camera(), format="jpeg")


def _picture(jpeg: bytes) -> ImageContent:
    data = base64.b64encode(jpeg).decode()
    return ImageContent(type="image", data=data, mime_type="image/jpeg")
