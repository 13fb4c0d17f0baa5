// Computes the probability that a part comes to rest in an aspect in which a robot can pick it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "resting_aspects_interfaces/msg/aspect_distribution.hpp"

struct Share
{
  double probability, lower, upper;  // 0 to 1
};

// Returns the share of all drops that ended in one of the aspects, with its Wilson interval (95 %).
// Before the first drop, the share is NaN and the interval is 0 to 1. Throws std::invalid_argument
// for an id that no aspect has.
inline Share pickable_share(
  const resting_aspects_interfaces::msg::AspectDistribution & distribution,
  const std::vector<std::int64_t> & ids)
{
  const auto & aspects = distribution.aspects;
  double count = 0.0;
  for (const auto id : std::set<std::int64_t>(ids.begin(), ids.end())) {  // without duplicates
    const auto aspect = std::find_if(
      aspects.begin(), aspects.end(), [id](const auto & each) {return each.id == id;});
    if (aspect == aspects.end()) {
      throw std::invalid_argument(
        "invalid aspect " + std::to_string(id) + ": expected 1 to " +
        std::to_string(aspects.size()));
    }
    count += static_cast<double>(aspect->count);
  }
  const double n = static_cast<double>(distribution.drops), p = count / n, z = 1.959963984540054;
  const double middle = (p + z * z / (2 * n)) / (1 + z * z / n);
  const double half = z * std::sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / (1 + z * z / n);
  return {p, std::max(0.0, middle - half), std::min(1.0, middle + half)};
}
