"""Definitions of messages of tracked objects, as their public specifications give them, for `rosbags`."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

AUTOWARE, NAV2, TEB = "autoware_perception_msgs/msg/", "nav2_dynamic_msgs/msg/", "costmap_converter_msgs/msg/"
DERIVED, VISION = "derived_object_msgs/msg/", "vision_msgs/msg/"

DEFINITIONS = "tracked_objects.msg"
"""File of the definitions, in the form in which MCAP files hold several."""
_SEPARATOR = "=" * 80 + "\nMSG: "

KINDS = (
    AUTOWARE + "PredictedObjects",
    AUTOWARE + "TrackedObjects",
    DERIVED + "ObjectArray",
    VISION + "Detection3DArray",
    NAV2 + "ObstacleArray",
    TEB + "ObstacleArrayMsg",
)
"""Kinds of messages that `tracked_objects` reads."""


def typestore() -> Any:
    """Give the types of ROS 2 and of tracked objects; a bag's own definitions take their place.

    Returns
    -------
    rosbags.typesys.store.Typestore

    Raises
    ------
    ImportError
        If `rosbags` is not installed.
    """
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError as error:
        raise ImportError("messages need rosbags: pip install 'scp-planner[ros]'") from error

    store, types = get_typestore(Stores.ROS2_HUMBLE), {}
    for definition in files(__package__).joinpath(DEFINITIONS).read_text(encoding="utf-8").split(_SEPARATOR)[1:]:
        name, _, text = definition.partition("\n")
        types.update(get_types_from_msg(text, name))
    store.register(types)
    return store
