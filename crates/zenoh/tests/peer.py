"""A client on Zenoh's own Python library that speaks as rmw_zenoh does, beside the example `zenoh_echo`: twenty messages there and back, twenty answers, and the
node's name."""
import struct
import sys
import time

import zenoh
from zenoh.ext import HistoryConfig, RecoveryConfig, declare_advanced_subscriber

PORT = sys.argv[1]
STRING = "std_msgs::msg::dds_::String_/RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
STATE = (
    "0/echo/state/lifecycle_msgs::srv::dds_::GetState_/"
    "RIHS01_800a0a5aae599782b02932de0caf563f6dc4e7e94b794eadde075ba2cbef9795"
)
GID = bytes(range(16))


def attachment(number):
    return struct.pack("<qqB", number, time.time_ns(), 16) + GID


def cdr(text):
    data = text.encode() + b"\0"
    return b"\0\1\0\0" + struct.pack("<I", len(data)) + data


def wait_until(done, seconds=20.0):
    end = time.monotonic() + seconds
    while not done() and time.monotonic() < end:
        time.sleep(0.005)


config = zenoh.Config.from_json5(
    '{mode: "peer", connect: {endpoints: ["tcp/localhost:%s"]}, listen: {endpoints: ["tcp/localhost:0"]},'
    " scouting: {multicast: {enabled: false}}, timestamping: {enabled: true}}" % PORT
)
session = zenoh.open(config)
tokens = {str(reply.ok.key_expr) for reply in session.liveliness().get("@ros2_lv/0/**") if reply.ok}
names = sum(token.split("/")[5] == "NN" and token.split("/")[8] == "echo" for token in tokens)
heard = []


def hear(sample):
    beside = sample.attachment.to_bytes()
    number, _, length = struct.unpack("<qqB", beside[:17])
    assert length == 16 and len(beside) == 33 and number > 0, beside
    heard.append(sample.payload.to_bytes())


history, recovery = HistoryConfig(detect_late_publishers=True, max_samples=1), RecoveryConfig(heartbeat=True)
subscriber = declare_advanced_subscriber(
    session, f"0/out/{STRING}", hear, history=history, recovery=recovery, subscriber_detection=True
)
zid = session.info.zid()
own = session.liveliness().declare_token(f"@ros2_lv/0/{zid}/0/1/MS/%/%/peer/%out/{STRING}/:1:,1:,:,:,,")
publisher = session.declare_publisher(f"0/in/{STRING}")
wait_until(lambda: publisher.matching_status.matching)
texts = [cdr("x" * (37 * k)) for k in range(20)]
for number, text in enumerate(texts, 1):
    publisher.put(text, attachment=attachment(number))
    wait_until(lambda: heard and heard[-1] == text, 5.0)
querier = session.declare_querier(STATE, target=zenoh.QueryTarget.ALL_COMPLETE, consolidation=zenoh.ConsolidationMode.NONE)
wait_until(lambda: querier.matching_status.matching)
answers = 0
for number in range(1, 21):
    for reply in querier.get(payload=b"\0\1\0\0\0", attachment=attachment(number)):
        beside = reply.ok.attachment.to_bytes()
        is_ours = struct.unpack("<q", beside[:8])[0] == number and beside[17:] == GID
        answers += is_ours and b"active" in reply.ok.payload.to_bytes()
print(f"{sum(text in heard for text in texts)} of 20 messages, {answers} of 20 answers, seen {'once' if names == 1 else names}")
session.close()
