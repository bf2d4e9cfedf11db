"""Back ends that run models of the `transformers` library, named by model id or folder.

    text_prompts.py         pure: what is asked for, and which class an answer belongs to
    model_runtime.py        device, precision, loading, unloading; errors (model_errors.py)
    zero_shot_detection.py  text to boxes: OWL-ViT, OWLv2, (MM) Grounding DINO, OmDet-Turbo
    sam2_masks.py           boxes to masks: SAM 2 and kin
    sam3_detection.py       text to masks at once: SAM 3
    detector.py             the detection back end made of these
    scorer.py               image against prompts: BLIP-2 (ITC, ITM), CLIP, SigLIP
    depth.py                colour to depth: Depth Pro, Depth Anything
    model_check.py          `python -m helios_detector.hf.model_check`: checks real weights

Nothing here imports torch or transformers before a model is opened.
"""
