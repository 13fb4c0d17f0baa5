// How probable it is that a part comes to rest in an aspect in which a robot can pick it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "resting_aspects_interfaces/msg/aspect_distribution.hpp"

// The sum of the aspects' probabilities, 0 to 1, each id once; NaN before the first drop.
// Throws std::invalid_argument for an id that no aspect of the part has.
inline double pickable_share(
  const resting_aspects_interfaces::msg::AspectDistribution & distribution,
  const std::vector<std::int64_t> & ids)
{
  const auto & aspects = distribution.aspects;
  double share = 0.0;
  for (const auto id : std::set<std::int64_t>(ids.begin(), ids.end())) {
    const auto aspect = std::find_if(
      aspects.begin(), aspects.end(), [id](const auto & each) {return each.id == id;});
    if (aspect == aspects.end()) {
      throw std::invalid_argument(
        "aspect " + std::to_string(id) + " is not known, allowed are 1 to " +
        std::to_string(aspects.size()));
    }
    share += aspect->probability;
  }
  return share;
}
