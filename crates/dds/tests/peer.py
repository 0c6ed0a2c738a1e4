"""A client of rclpy beside the example `echo`: twenty messages there and back, twenty answers, and the node's name."""
import time

import rclpy
from lifecycle_msgs.srv import GetState
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

rclpy.init()
node = rclpy.create_node("peer")
heard = []
reliable = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
node.create_subscription(String, "/out", lambda message: heard.append(message.data), reliable)
publisher = node.create_publisher(String, "/in", reliable)
client = node.create_client(GetState, "/echo/state")


def spin_until(done, seconds=20.0):
    end = time.monotonic() + seconds
    while not done() and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.05)


spin_until(lambda: publisher.get_subscription_count() and node.count_publishers("/out"))
time.sleep(0.5)
texts = ["x" * (37 * k) for k in range(20)]
for text in texts:
    publisher.publish(String(data=text))
    spin_until(lambda: heard and heard[-1] == text, 5.0)
answers = 0
client.wait_for_service(timeout_sec=10.0)
for _ in range(20):
    future = client.call_async(GetState.Request())
    spin_until(future.done, 10.0)
    answers += future.done() and future.result().current_state.label == "active"
names = node.get_node_names().count("echo")
print(f"{sum(text in heard for text in texts)} of 20 messages, {answers} of 20 answers, seen {'once' if names == 1 else names}")
