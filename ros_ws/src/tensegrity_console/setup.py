# SPDX-License-Identifier: Apache-2.0
from setuptools import find_packages, setup

package_name = "tensegrity_console"

setup(
    name=package_name,
    version="0.1.0",
    description="The six-strut tensegrity in a browser and in the Foxglove app.",
    license="Apache-2.0",
    maintainer="sixstrut maintainers",
    maintainer_email="no-address@sixstrut.invalid",
    packages=find_packages(),
    package_data={"tensegrity_console.web": ["page/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
)
