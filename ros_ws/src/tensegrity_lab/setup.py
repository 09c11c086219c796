# SPDX-License-Identifier: Apache-2.0
from setuptools import find_packages, setup

package_name = "tensegrity_lab"

setup(
    name=package_name,
    version="0.1.0",
    description="Experiments with the six-strut tensegrity: trials, studies, reports.",
    license="Apache-2.0",
    maintainer="sixstrut maintainers",
    maintainer_email="no-address@sixstrut.invalid",
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
)
