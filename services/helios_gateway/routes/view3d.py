"""`/view3d` and `/objects.viser`: viser's page, and the 3D scene of the Gaussians for it."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from helios_gateway import viewer_scene
from helios_gateway.api_keys import Scope
from helios_gateway.cached_responses import Encoded, conditional_response, content_docs
from helios_gateway.dependencies import Maps, secured
from helios_gateway.error_responses import problems
from helios_gateway.gaussian_arrays import ColorBy

HTML = "text/html"
# The page is one file with inline scripts that compile further code. It may connect only to this
# gateway.
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob:; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; "
    "connect-src 'self' data: blob:; worker-src blob: data:; frame-ancestors 'self'"
)
router = APIRouter(tags=["objects"], responses=problems(), dependencies=secured(Scope.READ))


@router.get(
    "/view3d",
    summary="Get the page of the 3D viewer",
    response_class=Response,
    responses=content_docs(HTML, "HTML page of viser"),
)
def view3d(request: Request) -> Response:
    """Return viser's page, which shows a scene in 3D.

    Parameters: `?playbackPath=/v1/objects.viser`, and viser's own, such as `darkMode` and
    `initialCameraPosition=X,Y,Z`. The page loads nothing from another host.
    """
    out = conditional_response(request, Encoded.of(viewer_scene.page(), HTML))
    out.headers["content-security-policy"] = POLICY
    return out


@router.get(
    "/objects.viser",
    summary="Export the Gaussians as a 3D scene for viser",
    response_class=Response,
    responses=content_docs(viewer_scene.MEDIA_TYPE, "scene file for viser"),
)
def scene(
    maps: Maps,
    request: Request,
    color: Annotated[
        ColorBy,
        Query(
            description="colour of each Gaussian: color (as observed), class (its most likely "
            "class), probability (of that class) or uncertainty (standard deviation of that "
            "probability)"
        ),
    ] = "color",
) -> Response:
    """Return the Gaussians as a viser scene, with labels of the instances above the map's ground.

    viser also shows the file without the gateway:
    https://viser.studio/main/embedded_visualizations/
    """
    return conditional_response(request, maps.scene(color))
