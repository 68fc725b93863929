"""The three nodes of one machine: `ros2 launch tbm_monitor tbm_monitor.launch.py namespace:=tbm`."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode

from launch import LaunchDescription
from tbm_msgs_py.nodes.registry import MACHINE_NODES


def generate_launch_description() -> LaunchDescription:
    """Describe the nodes, which activate themselves; `use_sim_time:=true` lets them follow a bag's clock."""
    parameters = Path(get_package_share_directory("tbm_monitor")) / "config" / "nodes.yaml"
    simulated = {"use_sim_time": LaunchConfiguration("use_sim_time")}
    nodes = [
        LifecycleNode(
            package="tbm_monitor",
            executable=name,
            name=name,
            namespace=LaunchConfiguration("namespace"),
            output="screen",
            parameters=[LaunchConfiguration("params_file"), simulated],
        )
        for name in MACHINE_NODES
    ]
    arguments = [
        DeclareLaunchArgument("namespace", default_value="tbm", description="one for each machine"),
        DeclareLaunchArgument("use_sim_time", default_value="false", description="follow /clock"),
        DeclareLaunchArgument("params_file", default_value=str(parameters), description="parameters of the nodes"),
    ]
    return LaunchDescription([*arguments, *nodes])
