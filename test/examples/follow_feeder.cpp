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
  std::cout << request.outer.points.size() << ' ' << request.outer.points[1].x << ' ' <<
    request.parts.front() << ' ' << none << first << touching << ' ';
  FeederAdvice advice;
  advice.choice = FeederAdvice::PICK;
  Epochs epochs;
  const auto print = [&](std::uint64_t epoch, std::uint64_t new_results, double age = 1.0) {
      advice.epoch = epoch;
      epochs.results += new_results;
      std::cout << action_of(advice, epochs, age) << '|';
    };
  print(5, 0);
  print(7, 2);
  print(7, 1);
  print(0, 0);  // of a controller that was started again
  print(0, 1);
  print(1, 0);
  print(1, 1);
  print(1, 0, 6.0);  // the result was lost, or the controller was started again at this epoch
  std::cout << std::endl;
}
