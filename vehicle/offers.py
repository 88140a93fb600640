"""What the package offers to command line, Python and launcher."""

from trepid.packages import Offers, Verb

OFFERS = Offers(
    verbs={
        "ros": Verb("vehicle.ros.package", "app", "The messages as a ROS 2 package."),
        "keys": Verb("vehicle.keys_cli", "app", "Certificates of the processes of a car."),
    },
    examples={
        "ros package": "trepid ros package ~/ros2_ws/src",
        "keys create": "trepid keys create mycar/keys",
    },
    publishes={
        "vehicle.actuators.node": ("vehicle/state",),
        "vehicle.cameras.node": ("camera/image", "camera/image/compressed"),
        "vehicle.driver.node": ("driver/input",),
    },
)
