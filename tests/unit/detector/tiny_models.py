"""Tiny models of every family, randomly initialised, written to a folder as a hub gives them.

Real classes, configurations, processors and tokenizers; only the sizes are small. One call per
family writes a folder that `from_pretrained` reads.
"""

from __future__ import annotations

import string
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from helios_detector.hf.model_runtime import need_library

hf = need_library()

LETTERS = string.ascii_lowercase + string.digits
SIDE = 64  # pixels of the small image encoders


def clip_tokenizer(length: int = 16) -> Any:
    """A byte-pair vocabulary of single letters; the end token has the highest id, as in CLIP's."""
    words = ["!", *LETTERS, ".", ",", *(f"{c}</w>" for c in (*LETTERS, ".", ","))]
    vocab = {w: i for i, w in enumerate([*words, "<|startoftext|>", "<|endoftext|>"])}
    return hf.CLIPTokenizer(
        vocab=vocab, merges=[], pad_token="!", unk_token="<|endoftext|>", model_max_length=length
    )


def bert_tokenizer(**kwargs: Any) -> Any:
    """A WordPiece vocabulary of letters; Grounding DINO needs four tokens at BERT's ids."""
    vocab = {f"[unused{i}]": i for i in range(1030)}
    own = {"[PAD]": 0, "[UNK]": 100, "[CLS]": 101, "[SEP]": 102, "[MASK]": 103, ".": 1012,
           "?": 1029, ",": 1010}  # fmt: skip
    own |= {c: 200 + i for i, c in enumerate(LETTERS)}
    own |= {f"##{c}": 300 + i for i, c in enumerate(LETTERS)}
    by_place = {i: w for w, i in vocab.items()} | {i: w for w, i in own.items()}
    return hf.BertTokenizer(vocab={w: i for i, w in by_place.items()}, **kwargs)


BERT = {
    "vocab_size": 1030,
    "hidden_size": 16,
    "num_hidden_layers": 1,
    "num_attention_heads": 2,
    "intermediate_size": 32,
    "max_position_embeddings": 256,
}
CLIP_TEXT = {"vocab_size": 128, "hidden_size": 16, "intermediate_size": 32,
             "num_hidden_layers": 1, "num_attention_heads": 2, "projection_dim": 16,
             "bos_token_id": 77, "eos_token_id": 78, "pad_token_id": 0}  # fmt: skip
SWIN = {
    "embed_dim": 8,
    "depths": [1, 1, 1, 1],
    "num_heads": [1, 1, 2, 2],
    "window_size": 4,
    "image_size": SIDE,
    "out_features": ["stage2", "stage3", "stage4"],
}
DETR_SIZE = {"shortest_edge": SIDE, "longest_edge": 96}


def _owl(model_type: str) -> tuple[Any, Any]:
    vision = {
        "hidden_size": 16,
        "intermediate_size": 32,
        "num_hidden_layers": 1,
        "num_attention_heads": 2,
        "image_size": SIDE,
        "patch_size": 16,
    }
    text = CLIP_TEXT | {"max_position_embeddings": 16}
    name = {"owlvit": "OwlViT", "owlv2": "Owlv2"}[model_type]
    config = getattr(hf, f"{name}Config")(text_config=text, vision_config=vision, projection_dim=16)
    images = getattr(hf, f"{name}ImageProcessor")(size={"height": SIDE, "width": SIDE})
    processor = getattr(hf, f"{name}Processor")(images, clip_tokenizer())
    return getattr(hf, f"{name}ForObjectDetection")(config), processor


def _dino(prefix: str) -> tuple[Any, Any]:
    config = getattr(hf, f"{prefix}Config")(
        backbone_config=hf.SwinConfig(**SWIN), text_config=hf.BertConfig(**BERT), d_model=32,
        encoder_layers=1, decoder_layers=2, encoder_ffn_dim=32, decoder_ffn_dim=32,
        encoder_attention_heads=2, decoder_attention_heads=2, num_queries=20,
        num_feature_levels=3, max_text_len=64,
    )  # fmt: skip
    images = hf.GroundingDinoImageProcessor(size=DETR_SIZE)
    return (
        getattr(hf, f"{prefix}ForObjectDetection")(config),
        hf.GroundingDinoProcessor(images, bert_tokenizer()),
    )


def _omdet() -> tuple[Any, Any]:
    config = hf.OmDetTurboConfig(
        text_config=hf.CLIPTextConfig(
            **CLIP_TEXT | {"max_position_embeddings": 77, "hidden_size": 24}
        ),
        backbone_config=hf.SwinConfig(**SWIN), num_queries=20, encoder_hidden_dim=16,
        decoder_hidden_dim=16, text_projection_in_dim=24, text_projection_out_dim=24,
        class_embed_dim=24, task_encoder_hidden_dim=32, vision_features_channels=[16, 16, 16],
        encoder_in_channels=[16, 32, 64], encoder_dim_feedforward=32, decoder_num_layers=1,
        decoder_dim_feedforward=32, encoder_attention_heads=2, decoder_num_heads=2,
        image_size=SIDE, apply_layernorm_after_vision_backbone=False,
    )  # fmt: skip
    images = hf.DetrImageProcessor(
        size={"height": SIDE, "width": SIDE}, do_pad=False, format="coco_detection"
    )
    return (
        hf.OmDetTurboForObjectDetection(config),
        hf.OmDetTurboProcessor(images, clip_tokenizer(77)),
    )


def _sam2() -> tuple[Any, Any]:
    backbone = hf.Sam2HieraDetConfig(
        hidden_size=8,
        num_attention_heads=1,
        image_size=[128, 128],
        blocks_per_stage=[1, 1, 2, 1],
        embed_dim_per_stage=[8, 16, 32, 64],
        num_attention_heads_per_stage=[1, 1, 2, 2],
        window_size_per_stage=[4, 2, 2, 2],
        global_attention_blocks=[3],
        window_positional_embedding_background_size=[4, 4],
    )
    vision = hf.Sam2VisionConfig(
        backbone_config=backbone,
        backbone_channel_list=[64, 32, 16, 8],
        backbone_feature_sizes=[[32, 32], [16, 16], [8, 8]],
        fpn_hidden_size=16,
    )
    config = hf.Sam2Config(
        vision_config=vision,
        prompt_encoder_config=hf.Sam2PromptEncoderConfig(
            hidden_size=16, image_size=128, patch_size=16, mask_input_channels=4
        ),
        mask_decoder_config=hf.Sam2MaskDecoderConfig(
            hidden_size=16,
            mlp_dim=32,
            num_hidden_layers=2,
            num_attention_heads=2,
            iou_head_hidden_dim=16,
        ),
    )
    images = hf.Sam2ImageProcessor(
        size={"height": 128, "width": 128}, mask_size={"height": 32, "width": 32}
    )
    return hf.Sam2Model(config), hf.Sam2Processor(images)


def _sam3() -> tuple[Any, Any]:
    side, patch = 112, 14
    backbone = hf.Sam3ViTConfig(
        hidden_size=16,
        intermediate_size=32,
        num_hidden_layers=2,
        num_attention_heads=2,
        image_size=side,
        patch_size=patch,
        pretrain_image_size=side,
        window_size=4,
        global_attn_indexes=[1],
    )
    cells = side // patch
    vision = hf.Sam3VisionConfig(
        backbone_config=backbone,
        fpn_hidden_size=16,
        backbone_feature_sizes=[[cells * 4] * 2, [cells * 2] * 2, [cells] * 2],
    )
    small: dict[str, Any] = {"hidden_size": 16, "num_attention_heads": 2, "intermediate_size": 32}
    config = hf.Sam3Config(
        vision_config=vision,
        text_config=hf.CLIPTextConfig(**CLIP_TEXT | {"max_position_embeddings": 32}),
        geometry_encoder_config=hf.Sam3GeometryEncoderConfig(**small, num_layers=1),
        detr_encoder_config=hf.Sam3DETREncoderConfig(**small, num_layers=1),
        detr_decoder_config=hf.Sam3DETRDecoderConfig(**small, num_layers=1, num_queries=12),
        mask_decoder_config=hf.Sam3MaskDecoderConfig(hidden_size=16, num_attention_heads=2),
    )
    images = hf.Sam3ImageProcessor(
        size={"height": side, "width": side}, mask_size={"height": 32, "width": 32}
    )
    return hf.Sam3Model(config), hf.Sam3Processor(images, clip_tokenizer(32))


VIT = {
    "hidden_size": 16,
    "intermediate_size": 32,
    "num_hidden_layers": 1,
    "num_attention_heads": 2,
    "image_size": 32,
    "patch_size": 8,
}


def _clip() -> tuple[Any, Any]:
    text = CLIP_TEXT | {"max_position_embeddings": 32}
    config = hf.CLIPConfig(text_config=text, vision_config=VIT, projection_dim=16)
    images = hf.CLIPImageProcessor(
        size={"shortest_edge": 32}, crop_size={"height": 32, "width": 32}
    )
    return hf.CLIPModel(config), hf.CLIPProcessor(images, clip_tokenizer(32))


def letters_sentencepiece() -> Any:
    """A unigram vocabulary of letters in the form of SigLIP 2's tokenizer."""
    from tokenizers import Tokenizer, models, normalizers, pre_tokenizers, processors

    pieces = [("<pad>", 0.0), ("<eos>", 0.0), ("<bos>", 0.0), ("<unk>", -10.0)]
    pieces += [(c, -3.0) for c in (*LETTERS, "▁", ".", ",")] + [(f"▁{c}", -2.5) for c in LETTERS]
    tokenizer = Tokenizer(models.Unigram(pieces, unk_id=3))
    tokenizer.normalizer = normalizers.Lowercase()
    tokenizer.pre_tokenizer = pre_tokenizers.Metaspace()
    tokenizer.post_processor = processors.TemplateProcessing("$A <eos>", None, [("<eos>", 1)])
    return hf.PreTrainedTokenizerFast(
        tokenizer_object=tokenizer,
        pad_token="<pad>",
        eos_token="<eos>",
        unk_token="<unk>",
        model_max_length=16,
        model_input_names=["input_ids"],
    )


def _siglip(version: str) -> tuple[Any, Any]:
    text = {"vocab_size": 128, "hidden_size": 16, "intermediate_size": 32, "num_hidden_layers": 1,
            "num_attention_heads": 2, "max_position_embeddings": 16, "projection_size": 16,
            "pad_token_id": 0, "bos_token_id": 2, "eos_token_id": 1}  # fmt: skip
    if version == "siglip":
        images = hf.SiglipImageProcessor(size={"height": 32, "width": 32})
        model = hf.SiglipModel(hf.SiglipConfig(text_config=text, vision_config=VIT))
        return model, hf.SiglipProcessor(images, letters_sentencepiece())
    vision = {k: v for k, v in VIT.items() if k != "image_size"} | {"num_patches": 16}
    images = hf.Siglip2ImageProcessor(patch_size=8, max_num_patches=16)
    model = hf.Siglip2Model(hf.Siglip2Config(text_config=text, vision_config=vision))
    return model, hf.Siglip2Processor(images, letters_sentencepiece())


def _blip2() -> tuple[Any, Any]:
    config = hf.Blip2Config(
        vision_config=VIT,
        qformer_config=BERT | {"encoder_hidden_size": 16, "use_qformer_text_input": True,
                               "cross_attention_frequency": 1, "vocab_size": 1032},
        text_config={"model_type": "opt", "vocab_size": 64, "hidden_size": 16, "ffn_dim": 16,
                     "num_hidden_layers": 1, "num_attention_heads": 2,
                     "word_embed_proj_dim": 16},
        num_query_tokens=4, image_text_hidden_size=16, image_token_index=1030,
    )  # fmt: skip
    images = hf.BlipImageProcessor(size={"height": 32, "width": 32})
    processor = hf.Blip2Processor(images, bert_tokenizer(), num_query_tokens=4)
    model = hf.Blip2ForImageTextRetrieval(config)
    with torch.no_grad():
        model.query_tokens.normal_()
    return model, processor


def _depth_pro(own_focal: bool = True) -> tuple[Any, Any]:
    vit = {"model_type": "dinov2", "hidden_size": 16, "num_hidden_layers": 4,
           "num_attention_heads": 2, "intermediate_size": 32, "image_size": 16, "patch_size": 4,
           "mlp_ratio": 2, "layerscale_value": 1.0}  # fmt: skip
    config = hf.DepthProConfig(
        fusion_hidden_size=16, patch_size=16, initializer_range=0.2,
        intermediate_hook_ids=[1, 0], intermediate_feature_dims=[8, 8],
        scaled_images_ratios=[0.5, 1.0], scaled_images_overlap_ratios=[0.5, 0.2],
        scaled_images_feature_dims=[16, 16], merge_padding_value=1,
        use_batch_norm_in_fusion_residual=False, use_bias_in_fusion_residual=True,
        use_fov_model=own_focal, num_fov_head_layers=2,
        image_model_config=vit, patch_model_config=vit, fov_model_config=vit,
    )  # fmt: skip
    images = hf.DepthProImageProcessor(size={"height": 32, "width": 32})
    model = hf.DepthProForDepthEstimation(config)
    with torch.no_grad():
        model.head.layers[-2].weight.mul_(0.001)
        model.head.layers[-2].bias.fill_(0.5)  # an inverse depth that is not clipped at 0
        if own_focal:
            model.fov_model.head.layers[-1].bias.fill_(60.0)  # degrees
    return model, images


def _depth_anything(metric: bool) -> tuple[Any, Any]:
    backbone = hf.Dinov2Config(
        hidden_size=16,
        num_hidden_layers=2,
        num_attention_heads=2,
        mlp_ratio=2,
        image_size=28,
        patch_size=14,
        out_features=["stage1", "stage2"],
        reshape_hidden_states=False,
        apply_layernorm=True,
    )
    config = hf.DepthAnythingConfig(
        backbone_config=backbone,
        reassemble_hidden_size=16,
        patch_size=14,
        reassemble_factors=[2, 1],
        neck_hidden_sizes=[8, 8],
        fusion_hidden_size=8,
        head_hidden_size=8,
        depth_estimation_type="metric" if metric else "relative",
        max_depth=20,
    )
    images = hf.DPTImageProcessor(
        size={"height": 56, "width": 56}, keep_aspect_ratio=True, ensure_multiple_of=14
    )
    return hf.DepthAnythingForDepthEstimation(config), images


FAMILIES: dict[str, Callable[[], tuple[Any, Any]]] = {
    "owlvit": lambda: _owl("owlvit"),
    "owlv2": lambda: _owl("owlv2"),
    "grounding-dino": lambda: _dino("GroundingDino"),
    "mm-grounding-dino": lambda: _dino("MMGroundingDino"),
    "omdet-turbo": _omdet,
    "sam2": _sam2,
    "sam3": _sam3,
    "clip": _clip,
    "siglip": lambda: _siglip("siglip"),
    "siglip2": lambda: _siglip("siglip2"),
    "blip-2": _blip2,
    "depth-pro": _depth_pro,
    "depth-pro without focal": lambda: _depth_pro(False),
    "depth-anything": lambda: _depth_anything(True),
    "depth-anything relative": lambda: _depth_anything(False),
}


def write(family: str, folder: Path, seed: int = 0) -> Path:
    """Writes model and processor to the folder and returns it."""
    torch.manual_seed(seed)
    model, processor = FAMILIES[family]()
    model.save_pretrained(folder)
    processor.save_pretrained(folder)
    return folder
