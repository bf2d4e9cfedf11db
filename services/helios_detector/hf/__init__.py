"""Back ends that run models of the `transformers` library, named by model id or folder.

    text_prompts.py         pure: prompts of a search context, and the class of each prompt
    model_runtime.py        device, precision, loading, unloading; errors (model_errors.py)
    zero_shot_detection.py  text to boxes: OWL-ViT, OWLv2, (MM) Grounding DINO, OmDet-Turbo
    sam2_masks.py           boxes to masks: SAM 2 and related models
    sam3_detection.py       text to boxes and masks in one model: SAM 3
    detector.py             detection back end made of these
    scorer.py               image against prompts: BLIP-2 (ITC, ITM), CLIP, SigLIP
    depth.py                colour to depth: Depth Pro, Depth Anything
    model_check.py          `python -m helios_detector.hf.model_check`: checks real weights

These modules import torch and transformers only when a model is opened.
"""
