// Prints the probability that a robot can pick a part, each time that its distribution changes.
// Build it from the folder of the suite, and run it:
//   colcon build --base-paths . resting_aspects_interfaces examples/cpp
//   ros2 run pickable_share pickable_share --ros-args -p part:=l_bracket -p pickable:='[1, 3]'
#include "pickable_share.hpp"

#include <cinttypes>
#include <exception>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "rclcpp/rclcpp.hpp"

using resting_aspects_interfaces::msg::AspectDistribution;

void run(const rclcpp::Node::SharedPtr & node)
{
  const auto part = node->declare_parameter("part", std::string("l_bracket"));
  const auto pickable = node->declare_parameter("pickable", std::vector<std::int64_t>{1});

  const auto print = [&](const AspectDistribution & distribution) {
      if (distribution.drops == 0) {
        return;  // a distribution without drops
      }
      try {
        const auto share = pickable_share(distribution, pickable);
        RCLCPP_INFO(
          node->get_logger(), "%s can be picked with probability %.3f (%.3f to %.3f): %" PRIu64
          " drops%s on %s", part.c_str(), share.probability, share.lower, share.upper,
          distribution.drops, distribution.complete ? "" : " (the run continues)",
          distribution.run.conditions.surface.c_str());
      } catch (const std::invalid_argument & error) {
        RCLCPP_ERROR(node->get_logger(), "parameter pickable: %s", error.what());
      }
    };
  // The QoS of the publisher: a late subscriber receives the newest message at once.
  const auto latched = rclcpp::QoS(1).reliable().transient_local();
  const auto subscription = node->create_subscription<AspectDistribution>(
    "aspect_distributions/" + part, latched, print);
  rclcpp::spin(node);
}

int main(int argc, char ** argv)
{
  int code = 0;
  try {
    rclcpp::init(argc, argv);
    run(std::make_shared<rclcpp::Node>("pickable_share"));
  } catch (const std::exception & error) {  // such as a parameter of another type
    RCLCPP_FATAL(rclcpp::get_logger("pickable_share"), "%s", error.what());
    code = 2;
  }
  rclcpp::shutdown();
  return code;
}
