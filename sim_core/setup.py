# SPDX-License-Identifier: Apache-2.0
from setuptools import find_packages, setup

package_name = "sim_core"

setup(
    name=package_name,
    version="0.1.0",
    description="Six-strut tensegrity: structure, VFIFE dynamics, rolls, gait library, twin.",
    license="Apache-2.0",
    maintainer="sixstrut maintainers",
    maintainer_email="no-address@sixstrut.invalid",
    packages=find_packages(),
    package_data={package_name: ["**/*.yaml", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{package_name}"]),
        (f"share/{package_name}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
)
