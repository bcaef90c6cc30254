"""Which pairs show the same scene."""

import re


def scene(name: str) -> str:
    """What the names of pairs of one scene have in common.

    That is the last part of the name without the numbers of the images: "oxford/graf_1_2",
    "oxford/graf_1_3" and "evd/graf" all show the scene "graf", and so do "graf/1_2" and
    "graf/1_10". A longer number after "_" names a photograph: "copr/IMG_0046" is its own scene.
    """
    return re.sub(r"(/1_\d+|(_\d)+)$", "", name).rpartition("/")[2]
