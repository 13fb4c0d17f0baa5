// Reads a serialised distribution from a file, and prints the share of some aspects and the interval:
//   share_of FILE [ID ...]
#include <fstream>
#include <iomanip>
#include <iostream>
#include <iterator>

#include "fastcdr/Cdr.h"
#include "pickable_share.hpp"
#include "resting_aspects_interfaces/msg/detail/aspect_distribution__rosidl_typesupport_fastrtps_cpp.hpp"

int main(int argc, char ** argv)
{
  std::ifstream file(argv[1], std::ios::binary);
  std::vector<char> bytes(std::istreambuf_iterator<char>(file), {});
  eprosima::fastcdr::FastBuffer buffer(bytes.data(), bytes.size());
  eprosima::fastcdr::Cdr cdr(
    buffer, eprosima::fastcdr::Cdr::DEFAULT_ENDIAN, eprosima::fastcdr::CdrVersion::XCDRv1);
  cdr.read_encapsulation();
  resting_aspects_interfaces::msg::AspectDistribution distribution;
  resting_aspects_interfaces::msg::typesupport_fastrtps_cpp::cdr_deserialize(cdr, distribution);

  std::vector<std::int64_t> ids;
  for (int k = 2; k < argc; ++k) {
    ids.push_back(std::stoll(argv[k]));
  }
  try {
    const auto share = pickable_share(distribution, ids);
    std::cout << std::setprecision(17) << share.probability << ' ' << share.lower << ' ' <<
      share.upper << std::endl;
  } catch (const std::invalid_argument & error) {
    std::cout << error.what() << std::endl;
    return 2;
  }
  return 0;
}
