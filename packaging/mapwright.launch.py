"""mapwright live beside a ROS 2 robot, in the place of slam_toolbox: `ros2 launch mapwright.launch.py params_file:=slam.yaml`.

Needs the command mapwright on the PATH, built with ROS 2, and no package of ROS but launch.
"""
import os
import shlex

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, ExecuteProcess, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration

ARGUMENTS = [
    ("node", "slam_toolbox", "name of the node, whose services have it"),
    ("params_file", "", "parameters by the names of slam_toolbox and AMCL"),
    ("use_sim_time", "false", "stamps are those of /clock"),
    ("output", os.path.join(os.path.expanduser("~"), "mapwright-live"), "folder of results, gone on with where there is a map"),
    ("localise", "", "a finished map in which the robot is found, and no map is made"),
    ("arguments", "", "more for the command line, such as '--view --points /points'"),
]


def command(context):
    given = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    words = ["mapwright", "live", "--node", given["node"], "-o", given["output"]]
    words += ["--localise", given["localise"]] if given["localise"] else ["--continue"]
    words += ["--params-file", given["params_file"]] if given["params_file"] else []
    words += ["--param", f"use_sim_time={given['use_sim_time']}"] + shlex.split(given["arguments"])
    # Ctrl-C writes the results, which takes as long as a large map does.
    process = ExecuteProcess(cmd=words, output="screen", emulate_tty=True, sigterm_timeout="120")
    ended = OnProcessExit(target_action=process, on_exit=[EmitEvent(event=Shutdown(reason="mapwright has ended"))])
    return [process, RegisterEventHandler(ended)]


def generate_launch_description():
    declared = [DeclareLaunchArgument(name, default_value=value, description=why) for name, value, why in ARGUMENTS]
    return LaunchDescription(declared + [OpaqueFunction(function=command)])
