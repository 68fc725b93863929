"""The one place that names the dependencies and the data files; the executables are those of the registry of nodes."""

import runpy
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

HERE = Path(__file__).parent
PACKAGE = "tbm_monitor"
# The version stands where ROS tools look for it, and nowhere else.
VERSION = ElementTree.parse(HERE / "package.xml").findtext("version")  # noqa: S314 - our own file

# Wheels of ROS 2 Jazzy exist for x86-64 Linux; elsewhere, and in a native workspace, ROS comes from the system.
ON_WHEEL_PLATFORM = 'sys_platform == "linux" and platform_machine == "x86_64"'

REQUIRED = [
    "numpy>=1.26",
    "scipy>=1.11.4",
    "numba>=0.59",
    "pydantic>=2.5",
    "pyyaml>=6.0",
    "ruamel.yaml>=0.17.21",
    "tzdata>=2024.1",  # names of time zones, where the system has none
    "mcap>=1.5",
    "lz4>=4.0",
    "zstandard>=0.19",
    "isal>=1.6",
    "rosbags>=0.10.8",
    "scikit-learn>=1.4",
    "threadpoolctl>=3.1",
    "SALib>=1.4.7",
    "emcee>=3.1",
    "typer>=0.19",
    "rich>=13.0",
    "jinja2>=3.1",
    "matplotlib>=3.8",
    "pillow>=10.0",
]
ROS_WHEELS = [f"ros-jazzy-{name}; {ON_WHEEL_PLATFORM}" for name in ("rclpy", "common-interfaces", "rmw-fastrtps-cpp")]
NODES = runpy.run_path(str(HERE / "tbm_msgs_py" / "nodes" / "registry.py"))["NODES"]
CLUSTER = ["distributed>=2024.1"]
# Formats of `tbm-monitor bag import` beside CSV, WAV and MATLAB up to 7.2.
IMPORT = ["nptdms>=1.9", "asammdf>=8.0", "h5py>=3.10"]
EXPORT = ["pyarrow>=14.0"]  # of `tbm-monitor history export` to Parquet
LIVE = ["foxglove-sdk>=0.14"]
WEB = ["aiohttp>=3.9"]
DOCS = ["sphinx>=7.3", "myst-parser>=3.0", "furo>=2024.1"]
TEST = [
    *CLUSTER,
    *IMPORT,
    *EXPORT,
    *LIVE,
    *WEB,
    "pytest>=8",
    "pytest-xdist>=3.7",
    "pytest-cov>=7.0",
    "hypothesis>=6.90",
    "mcap-ros2-support>=0.5",
    "mypy>=1.10",
    "ruff>=0.6",
    "import-linter>=2.0",
    "smt>=2.6",
    "colcon-ros>=0.5",
    "psutil>=5.9",
    "websockets>=13",
    "selenium>=4.20",  # drives the Chromium that is installed, where there is one
    "types-PyYAML",
    "build>=1.0",
    "setuptools>=61",  # of the build, which a virtual environment no longer brings along
    "wheel",
]


def data_files() -> list[tuple[str, list[str]]]:
    """Files that `ros2` tools look for under share/, the shipped recording among them."""
    share = f"share/{PACKAGE}"
    groups = [
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (share, ["package.xml"]),
    ]
    bags = sorted(str(path.relative_to(HERE)) for path in (HERE / "bags").glob("*") if path.is_dir())
    for folder in ("launch", "config", "config/layouts", *bags):
        files = sorted(str(p.relative_to(HERE)) for p in (HERE / folder).glob("*") if p.is_file())
        groups.append((f"{share}/{folder}", files))
    return groups


setup(
    name=PACKAGE,
    version=VERSION,
    description="Drive-train monitor for tunnel boring machines: dynamics, field comparison, sensitivity analysis",
    long_description=(HERE / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    author="tbm_monitor developers",
    maintainer="tbm_monitor developers",
    maintainer_email="maintainers@tbm-monitor.org",
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=["tbm_*"]),
    package_data={
        "tbm_dynamics": ["machines/*.yaml", "machines/*.csv", "py.typed"],
        "tbm_msgs_py": ["nodes/loopback.xml", "py.typed"],
        "tbm_gsa": ["app/report/*.html", "app/web/static/*", "py.typed"],
    },
    data_files=data_files(),
    zip_safe=False,
    install_requires=REQUIRED + ROS_WHEELS,
    extras_require={
        "cluster": CLUSTER,
        "import": IMPORT,
        "export": EXPORT,
        "live": LIVE,
        "web": WEB,
        "docs": DOCS,
        "test": TEST,
    },
    entry_points={
        "console_scripts": [
            "tbm-monitor = tbm_gsa.app.cli.start:main",
            *(f"{node} = tbm_gsa.app.nodes.start:main" for node in NODES),
        ]
    },
)
