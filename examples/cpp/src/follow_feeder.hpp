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

// Which advice is current: an advice of before the last result may name parts that were picked.
struct Epochs
{
  bool known = false;
  std::uint64_t first = 0, last = 0;  // epoch of the first advice, and of the newest one
  std::uint64_t results = 0;  // messages that this program has published on pick_result since the first

  // Returns whether an advice with this epoch contains all results, the last of which is this old, s.
  // A controller that was started again counts epochs from 0, and may not have received a result: a
  // lower epoch than before, or one that is too low for PATIENCE, begins anew.
  bool is_current(std::uint64_t epoch, double age)
  {
    constexpr double PATIENCE = 5.0;  // s
    if (!known || epoch < last || (epoch < first + results && age > PATIENCE)) {
      known = true;
      first = epoch;
      results = 0;
    }
    last = epoch;
    return epoch >= first + results;
  }
};

// Returns the action that the advice is to do now, or nothing if it must not be followed. The last
// result is ``age`` s old.
inline std::string action_of(
  const resting_aspects_interfaces::msg::FeederAdvice & advice, Epochs & epochs, double age)
{
  using Advice = resting_aspects_interfaces::msg::FeederAdvice;
  if (!epochs.is_current(advice.epoch, age)) {
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
