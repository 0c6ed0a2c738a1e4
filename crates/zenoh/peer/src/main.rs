//! Beside the example `zenoh_echo`: twenty messages there and back, twenty answers, and the node's name.

use hiroz::context::ZContextBuilder;
use hiroz::entity::{TypeHash, TypeInfo};
use hiroz::msg::{SerdeCdrSerdes, ZMessage, ZService};
use hiroz::qos::{QosDurability, QosHistory, QosProfile, QosReliability};
use hiroz::{Builder, MessageTypeInfo, Result, ServiceTypeInfo};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, MessageTypeInfo)]
#[ros_msg(type_name = "std_msgs/msg/String")]
struct Text {
    data: String,
}

#[derive(Debug, Clone, Default, Serialize, Deserialize, MessageTypeInfo)]
#[ros_msg(type_name = "lifecycle_msgs/srv/GetState_Request")]
struct Asked {
    structure_needs_at_least_one_member: u8,
}

#[derive(Debug, Clone, Default, Serialize, Deserialize, MessageTypeInfo)]
#[ros_msg(type_name = "lifecycle_msgs/srv/GetState_Response")]
struct Said {
    id: u8,
    label: String,
}

impl ZMessage for Text {
    type Serdes = SerdeCdrSerdes<Self>;
}
impl ZMessage for Asked {
    type Serdes = SerdeCdrSerdes<Self>;
}
impl ZMessage for Said {
    type Serdes = SerdeCdrSerdes<Self>;
}

struct GetState;

impl ServiceTypeInfo for GetState {
    fn service_type_info() -> TypeInfo {
        let hash = "RIHS01_800a0a5aae599782b02932de0caf563f6dc4e7e94b794eadde075ba2cbef9795";
        TypeInfo::new("lifecycle_msgs::srv::dds_::GetState_", TypeHash::from_rihs_string(hash).expect("a hash"))
    }
}

impl ZService for GetState {
    type Request = Asked;
    type Response = Said;
}

#[tokio::main]
async fn main() -> Result<()> {
    let port = std::env::args().nth(1).expect("expected a port");
    let context = ZContextBuilder::default().with_router_endpoint(format!("tcp/localhost:{port}"))?.build()?;
    let node = context.create_node("peer").build()?;
    let reliable = QosProfile { reliability: QosReliability::Reliable, history: QosHistory::from_depth(100), ..QosProfile::default() };
    let kept = QosProfile { durability: QosDurability::TransientLocal, history: QosHistory::from_depth(1), ..reliable };
    let publisher = node.create_pub::<Text>("/in").with_qos(reliable).build()?;
    let subscriber = node.create_sub::<Text>("/out").with_qos(kept).build()?;
    let client = node.create_client::<GetState>("/echo/state").build()?;
    publisher.wait_for_subscription(1, Duration::from_secs(20)).await;
    subscriber.wait_for_publisher(1, Duration::from_secs(20)).await;
    tokio::time::sleep(Duration::from_millis(500)).await;
    let mut messages = 0;
    for length in 0..20 {
        let text = Text { data: "x".repeat(37 * length) };
        publisher.async_publish(&text).await?;
        messages += usize::from(subscriber.recv_timeout(Duration::from_secs(5)).is_ok_and(|heard| heard == text));
    }
    let mut answers = 0;
    let begun = Instant::now();
    while answers < 20 && begun.elapsed() < Duration::from_secs(20) {
        let answer = client.call_with_timeout(&Asked::default(), Duration::from_secs(5)).await;
        answers += usize::from(answer.is_ok_and(|said| said.id == 3 && said.label == "active"));
    }
    let names = node.graph().get_node_names().into_iter().filter(|(name, _)| name == "echo").count();
    let seen = if names == 1 { "once".to_owned() } else { names.to_string() };
    println!("{messages} of 20 messages, {answers} of 20 answers, seen {seen}");
    Ok(())
}
