// Requests the distribution of a part, with a second request if no answer arrives in time.
//   ros2 run pickable_share ask_distribution --ros-args -p part:=l_bracket -p drops:=1000
#include <chrono>
#include <cinttypes>
#include <cstdint>
#include <exception>
#include <memory>
#include <string>

#include "rclcpp/rclcpp.hpp"
#include "resting_aspects_interfaces/srv/get_distribution.hpp"

using resting_aspects_interfaces::msg::Status;
using resting_aspects_interfaces::srv::GetDistribution;

int ask(const rclcpp::Node::SharedPtr & node)
{
  const auto request = std::make_shared<GetDistribution::Request>();
  request->part = node->declare_parameter("part", std::string("l_bracket"));
  request->drops = static_cast<std::uint64_t>(node->declare_parameter("drops", std::int64_t{1000}));
  const auto timeout = std::chrono::duration<double>(node->declare_parameter("timeout", 60.0));
  // Every client receives the answers to all clients: with the default depth of 10, answers are lost
  // while many clients ask at once.
  const auto client = node->create_client<GetDistribution>(
    "get_distribution", rclcpp::ServicesQoS().keep_last(1000));
  for (int attempt = 1; attempt <= 2; ++attempt) {
    if (!client->wait_for_service(timeout)) {
      break;
    }
    // A second request does not start a second run: both receive the drops of the first.
    auto answer = client->async_send_request(request);
    if (rclcpp::spin_until_future_complete(node, answer, timeout) ==
      rclcpp::FutureReturnCode::SUCCESS)
    {
      const auto response = answer.get();
      if (response->status.code != Status::OK) {
        RCLCPP_ERROR(node->get_logger(), "%s", response->status.message.c_str());
        return 1;
      }
      for (const auto & aspect : response->distribution.aspects) {
        RCLCPP_INFO(
          node->get_logger(), "aspect %" PRIu32 ": %.3f (%.3f to %.3f)", aspect.id,
          aspect.probability, aspect.lower, aspect.upper);
      }
      return 0;
    }
    client->remove_pending_request(answer);
  }
  RCLCPP_ERROR(node->get_logger(), "no answer within %.0f s", timeout.count());
  return 1;
}

int main(int argc, char ** argv)
{
  int code = 2;
  try {
    rclcpp::init(argc, argv);
    code = ask(std::make_shared<rclcpp::Node>("ask_distribution"));
  } catch (const std::exception & error) {  // such as a parameter of another type
    RCLCPP_FATAL(rclcpp::get_logger("ask_distribution"), "%s", error.what());
  }
  rclcpp::shutdown();
  return code;
}
