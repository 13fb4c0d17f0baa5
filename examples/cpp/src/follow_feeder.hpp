// Makes requests of identify_part, and reads its answers and the advice of feeder_controller.
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "resting_aspects_interfaces/msg/feeder_advice.hpp"
#include "resting_aspects_interfaces/srv/identify_part.hpp"

// Returns the request for an outline of one part: points in m, in the tray frame (x right, y up, seen
// from above).
inline resting_aspects_interfaces::srv::IdentifyPart::Request identification_request(
  const std::vector<std::pair<double, double>> & outline, const std::string & part)
{
  resting_aspects_interfaces::srv::IdentifyPart::Request request;
  for (const auto & [x, y] : outline) {
    request.outer.points.emplace_back();
    request.outer.points.back().x = static_cast<float>(x);
    request.outer.points.back().y = static_cast<float>(y);
  }
  request.parts = {part};
  return request;
}

// Returns the most probable candidate, or nullptr if the outline probably shows no known part, or
// several parts that touch.
inline const resting_aspects_interfaces::msg::PartCandidate * best_candidate(
  const resting_aspects_interfaces::srv::IdentifyPart::Response & answer)
{
  const auto other = std::max(answer.none_probability, answer.touching_probability);
  if (answer.candidates.empty() || answer.candidates.front().posterior <= other) {
    return nullptr;
  }
  return &answer.candidates.front();
}

// Returns the action that the advice is to do now. `results` is the number of messages that this
// program has published on pick_result since it received an advice with `epoch` first: an advice that
// does not contain them yet may name parts that were picked, and must not be followed.
inline std::string action_of(
  const resting_aspects_interfaces::msg::FeederAdvice & advice, std::uint64_t epoch,
  std::uint64_t results)
{
  using Advice = resting_aspects_interfaces::msg::FeederAdvice;
  if (advice.epoch < epoch + results) {
    return "";
  }
  switch (advice.choice) {
    case Advice::PICK:
      return "pick";
    case Advice::FLIP:
      return "flip";
    case Advice::SPREAD:
      return "spread";
    case Advice::SUPPLY:
      return "supply";
    default:
      return "wait";
  }
}
