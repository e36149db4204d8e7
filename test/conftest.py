"""Set before anything imports rclpy or numpy: strict messages, one thread, a DDS domain of this process's own."""

import os
import sys

os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ.setdefault("OMP_NUM_THREADS", "1")


def pytest_terminal_summary(terminalreporter):
    """How many cases the fuzz tests have run, where any did."""
    fuzzing = sys.modules.get("fuzzing")
    for line in fuzzing.report() if fuzzing else ():
        terminalreporter.write_line(line)
