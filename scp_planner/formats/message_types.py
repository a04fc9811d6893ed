"""Definitions of messages of tracked objects, as their public specifications give them, for `rosbags`."""

from __future__ import annotations

from typing import Any

AUTOWARE, NAV2, TEB = "autoware_perception_msgs/msg/", "nav2_dynamic_msgs/msg/", "costmap_converter_msgs/msg/"
DERIVED, VISION = "derived_object_msgs/msg/", "vision_msgs/msg/"

_AUTOWARE_OBJECT = """
unique_identifier_msgs/UUID object_id
float32 existence_probability
ObjectClassification[] classification
{}ObjectKinematics kinematics
Shape shape
"""

DEFINITIONS = {
    AUTOWARE + "ObjectClassification": "uint8 label\nfloat32 probability",
    AUTOWARE + "Shape": "uint8 type\ngeometry_msgs/Polygon footprint\ngeometry_msgs/Vector3 dimensions",
    AUTOWARE + "PredictedPath": "geometry_msgs/Pose[] path\nbuiltin_interfaces/Duration time_step\nfloat32 confidence",
    AUTOWARE + "PredictedObjectKinematics": """
geometry_msgs/PoseWithCovariance initial_pose_with_covariance
geometry_msgs/TwistWithCovariance initial_twist_with_covariance
geometry_msgs/AccelWithCovariance initial_acceleration_with_covariance
PredictedPath[] predicted_paths
""",
    AUTOWARE + "PredictedObject": _AUTOWARE_OBJECT.format("Predicted"),
    AUTOWARE + "PredictedObjects": "std_msgs/Header header\nPredictedObject[] objects",
    AUTOWARE + "TrackedObjectKinematics": """
geometry_msgs/PoseWithCovariance pose_with_covariance
geometry_msgs/TwistWithCovariance twist_with_covariance
geometry_msgs/AccelWithCovariance acceleration_with_covariance
uint8 orientation_availability
bool is_stationary
""",
    AUTOWARE + "TrackedObject": _AUTOWARE_OBJECT.format("Tracked"),
    AUTOWARE + "TrackedObjects": "std_msgs/Header header\nTrackedObject[] objects",
    DERIVED + "Object": """
std_msgs/Header header
uint32 id
uint8 detection_level
bool object_classified
geometry_msgs/Pose pose
geometry_msgs/Twist twist
geometry_msgs/Accel accel
geometry_msgs/Polygon polygon
shape_msgs/SolidPrimitive shape
uint8 classification
uint8 classification_certainty
uint32 classification_age
""",
    DERIVED + "ObjectArray": "std_msgs/Header header\nObject[] objects",
    VISION + "ObjectHypothesis": "string class_id\nfloat64 score",
    VISION + "ObjectHypothesisWithPose": "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose",
    VISION + "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    VISION + "Detection3D": """
std_msgs/Header header
ObjectHypothesisWithPose[] results
BoundingBox3D bbox
string id
""",
    VISION + "Detection3DArray": "std_msgs/Header header\nDetection3D[] detections",
    NAV2 + "Obstacle": """
unique_identifier_msgs/UUID uuid
float32 score
geometry_msgs/Point position
geometry_msgs/Vector3 velocity
geometry_msgs/Vector3 size
float64[9] position_covariance
float64[9] velocity_covariance
""",
    NAV2 + "ObstacleArray": "std_msgs/Header header\nObstacle[] obstacles",
    TEB + "ObstacleMsg": """
std_msgs/Header header
geometry_msgs/Polygon polygon
float64 radius
int64 id
geometry_msgs/Quaternion orientation
geometry_msgs/TwistWithCovariance velocities
""",
    TEB + "ObstacleArrayMsg": "std_msgs/Header header\nObstacleMsg[] obstacles",
}
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
    for name, text in DEFINITIONS.items():
        types.update(get_types_from_msg(text, name))
    store.register(types)
    return store
