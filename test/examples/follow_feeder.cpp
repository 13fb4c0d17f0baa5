// Checks the header of the example follow_feeder.
#include "follow_feeder.hpp"

#include <cmath>
#include <iostream>

int main()
{
  using resting_aspects_interfaces::msg::FeederAdvice;
  const auto request = identification_request({{0.0, 0.0}, {0.04, 0.0}, {0.0, 0.02}}, "nut");
  resting_aspects_interfaces::srv::IdentifyPart::Response answer;
  answer.none_probability = 0.3;
  const bool none = best_candidate(answer) == nullptr;
  answer.candidates.resize(2);
  answer.candidates.front().posterior = 0.6;
  const bool first = best_candidate(answer) == &answer.candidates.front();
  answer.touching_probability = 0.6;
  const bool touching = best_candidate(answer) == nullptr;
  FeederAdvice advice;
  advice.epoch = 7;
  advice.choice = FeederAdvice::PICK;
  std::cout << request.outer.points.size() << ' ' << request.outer.points[1].x << ' ' <<
    request.parts.front() << ' ' << none << first << touching << ' ' <<
    action_of(advice, 5, 2) << '|' << action_of(advice, 5, 3) << std::endl;
}
