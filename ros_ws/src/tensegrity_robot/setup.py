# SPDX-License-Identifier: Apache-2.0
from glob import glob

from setuptools import find_packages, setup

package_name = "tensegrity_robot"

setup(
    name=package_name,
    version="0.1.0",
    description="ROS 2 nodes of the six-strut rolling tensegrity: twin, gait planner, hardware bridge.",
    license="Apache-2.0",
    maintainer="sixstrut maintainers",
    maintainer_email="no-address@sixstrut.invalid",
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
        (f"share/{package_name}/launch", sorted(glob("launch/*.launch.py"))),
        (f"share/{package_name}/config", sorted([*glob("config/*.yaml"), *glob("config/*.xml")])),
        (f"share/{package_name}/foxglove", sorted(glob("foxglove/*"))),
        (f"share/{package_name}/rviz", sorted(glob("rviz/*"))),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "twin = tensegrity_robot.twin.twin_node:main",
            "gait_planner = tensegrity_robot.planner.gait_planner_node:main",
            "traveller = tensegrity_robot.planner.traveller_node:main",
            "hardware_bridge = tensegrity_robot.bridge.hardware_bridge_node:main",
            "imu_driver = tensegrity_robot.imu.imu_driver_node:main",
            "face_estimator = tensegrity_robot.imu.face_estimator_node:main",
            # hardware_bridge's own executable, so that one package name starts every process of a session
            "virtual_prototype = hardware_bridge.virtual_prototype.__main__:main",
        ],
    },
)
