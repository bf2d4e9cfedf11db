"""Names of the things of a household, from general knowledge.

An agent may ask the detector for all of them beside the classes of its task. A look-alike then gets
its own name too, which tells it apart. Each kind of thing stands here once: the detector knows the
synonyms.
"""

from __future__ import annotations


def _names(text: str) -> frozenset[str]:
    return frozenset(" ".join(name.split()) for name in text.split(","))


OBJECTS = _names(
    """
    apple, banana, orange, lemon, pear, peach, tomato, potato, carrot, onion, bread, cake, egg,
    bottle, wine bottle, can, jar, cup, mug, glass, wine glass, bowl, plate, pan, pot, kettle,
    teapot, pitcher, fork, knife, spoon, spatula, ladle, whisk, cutting board, salt shaker,
    pepper shaker, toaster, coffee maker, blender, sponge, soap bottle, soap dispenser, box,
    cereal box, lunch box, tray, basket, thermos, book, magazine, newspaper, remote control,
    game controller, candle, vase, plant, picture frame, clock, alarm clock, lamp, table lamp,
    desk lamp, pillow, cushion, blanket, teddy bear, doll, toy car, toy, ball, tennis ball,
    basketball, football, dice, rubik's cube, tissue box, speaker, radio, camera, headphones,
    statue, laptop, tablet, phone, keyboard, mouse, stapler, tape, scissors, pen, pencil, notebook,
    binder, calculator, handbag, backpack, suitcase, hat, cap, shoe, slipper, boot, glove, scarf,
    umbrella, watch, wallet, keys, glasses, toothbrush, toothpaste, towel, toilet paper, soap,
    shampoo bottle, hairbrush, comb, hair dryer, perfume bottle, hammer, screwdriver, flashlight,
    drill, bucket, watering can
    """
)
FURNITURE = _names(
    """
    chair, armchair, stool, bench, ottoman, sofa, bed, coffee table, dining table, side table, desk,
    console table, nightstand, dresser, cabinet, wardrobe, bookcase, shoe rack, tv stand,
    television, kitchen counter, kitchen island, sink, washstand, bathtub, toilet, refrigerator,
    oven, stove, dishwasher, washing machine, dryer, microwave, filing cabinet, trolley,
    laundry basket, trash can, storage chest, wall cabinet, fireplace, piano, radiator, rug, mirror,
    floor lamp, crib, sideboard, shower, door, window, curtain
    """
)
HOUSEHOLD_NAMES = tuple(sorted(OBJECTS | FURNITURE))
