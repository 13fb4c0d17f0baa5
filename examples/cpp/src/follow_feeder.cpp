// Identifies an outline, then follows the advice of feeder_controller: prints what a robot would do.
//   ros2 run pickable_share follow_feeder --ros-args -p part:=l_bracket
#include "follow_feeder.hpp"

#include <chrono>
#include <exception>
#include <memory>
#include <string>

#include "rclcpp/rclcpp.hpp"
#include "resting_aspects_interfaces/msg/pick_result.hpp"

using resting_aspects_interfaces::msg::FeederAdvice;
using resting_aspects_interfaces::msg::PickResult;
using resting_aspects_interfaces::msg::Status;
using resting_aspects_interfaces::srv::IdentifyPart;

void identify(const rclcpp::Node::SharedPtr & node, const std::string & part)
{
  const auto client = node->create_client<IdentifyPart>(
    "identify_part", rclcpp::ServicesQoS().keep_last(1000));
  const auto timeout = std::chrono::seconds(60);
  if (!client->wait_for_service(timeout)) {
    RCLCPP_ERROR(node->get_logger(), "identify_part is not offered");
    return;
  }
  // A contour of the vision system, here of l_bracket on its side.
  const auto request = std::make_shared<IdentifyPart::Request>(
    identification_request({{0.0, 0.0}, {0.04, 0.0}, {0.04, 0.02}, {0.0, 0.02}}, part));
  auto answer = client->async_send_request(request);
  if (rclcpp::spin_until_future_complete(node, answer, timeout) !=
    rclcpp::FutureReturnCode::SUCCESS)
  {
    client->remove_pending_request(answer);
    RCLCPP_ERROR(node->get_logger(), "no answer of identify_part");
    return;
  }
  const auto response = answer.get();
  if (response->status.code != Status::OK) {
    RCLCPP_ERROR(node->get_logger(), "%s", response->status.message.c_str());
  } else if (const auto * best = best_candidate(*response)) {
    RCLCPP_INFO(
      node->get_logger(), "%s, class %u, probability %.3f", best->part.c_str(),
      best->symmetry_class, best->posterior);
  } else {
    RCLCPP_INFO(node->get_logger(), "no single known part");
  }
}

void run(const rclcpp::Node::SharedPtr & node)
{
  const auto part = node->declare_parameter("part", std::string("l_bracket"));
  identify(node, part);
  const auto results = node->create_publisher<PickResult>("pick_result", rclcpp::QoS(10));
  Epochs epochs;
  auto last_result = node->get_clock()->now();
  const auto follow = [&](const FeederAdvice & advice) {
      const auto age = (node->get_clock()->now() - last_result).seconds();
      const auto action = action_of(advice, epochs, age);
      if (action.empty()) {
        return;  // of before the last result
      }
      RCLCPP_INFO(node->get_logger(), "%s: %s", action.c_str(), advice.reason.c_str());
      if (action == "pick" && !advice.picks.empty()) {
        const auto & pick = advice.picks.front();
        // Here the robot moves to pick.poses.front(), the pose of the part in advice.header.frame_id.
        PickResult result;
        result.header.stamp = node->get_clock()->now();
        result.image = advice.image;
        result.detection = pick.detection;
        result.result = PickResult::PICKED;
        results->publish(result);
        last_result = result.header.stamp;
        ++epochs.results;
      }
      // A machine that flips, spreads or supplies publishes a result MOVED here once parts are at
      // rest, and counts it in the same way.
    };
  // The QoS of the publisher: a late subscriber receives the newest message at once.
  const auto subscription = node->create_subscription<FeederAdvice>(
    "feeder_advice/" + part, rclcpp::QoS(1).reliable().transient_local(), follow);
  rclcpp::spin(node);
}

int main(int argc, char ** argv)
{
  int code = 0;
  try {
    rclcpp::init(argc, argv);
    run(std::make_shared<rclcpp::Node>("follow_feeder"));
  } catch (const std::exception & error) {  // such as a parameter of another type
    RCLCPP_FATAL(rclcpp::get_logger("follow_feeder"), "%s", error.what());
    code = 2;
  }
  rclcpp::shutdown();
  return code;
}
