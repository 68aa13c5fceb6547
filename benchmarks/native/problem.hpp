// The problem that benchmarks/solvers.py writes, and the equations of graphslam/models in C++.
#pragma once

#include <sys/resource.h>

#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

struct Problem {
  int64_t nodes = 0, lines = 0, sightings = 0;
  std::vector<double> pose, line, start, start_whitener, increment, whitener, z, z_whitener;
  std::vector<int64_t> node, landmark;
};

template <class T>
void read_array(std::ifstream& in, std::vector<T>& out, int64_t count) {
  out.resize(count);
  in.read(reinterpret_cast<char*>(out.data()), count * sizeof(T));
  if (!in) throw std::runtime_error("the problem file is short");
}

inline Problem read_problem(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::vector<int64_t> head;
  read_array(in, head, 3);
  Problem p;
  p.nodes = head[0], p.lines = head[1], p.sightings = head[2];
  read_array(in, p.pose, 3 * p.nodes);
  read_array(in, p.line, 2 * p.lines);
  read_array(in, p.start, 3);
  read_array(in, p.start_whitener, 9);
  read_array(in, p.increment, 3 * (p.nodes - 1));
  read_array(in, p.whitener, 9 * (p.nodes - 1));
  read_array(in, p.node, p.sightings);
  read_array(in, p.landmark, p.sightings);
  read_array(in, p.z, 2 * p.sightings);
  read_array(in, p.z_whitener, 4 * p.sightings);
  return p;
}

inline double wrap(double angle) {
  return angle - 2.0 * M_PI * std::ceil((angle - M_PI) / (2.0 * M_PI));
}

// Residual (2) of a line sighting, Jacobians row-major by the pose (2x3) and the line (2x2).
inline void line_residual(const double* pose, const double* line, const double* z, double* e,
                          double* J_pose, double* J_line) {
  const double c = std::cos(line[1]), s = std::sin(line[1]);
  double sign = 1.0, turn = wrap(line[1] - pose[2] - z[1]);
  if (std::abs(turn) > 0.5 * M_PI) sign = -1.0, turn = wrap(turn + M_PI);
  e[0] = sign * (line[0] - pose[0] * c - pose[1] * s) - z[0];
  e[1] = turn;
  if (J_pose) {
    const double J[6] = {-sign * c, -sign * s, 0.0, 0.0, 0.0, -1.0};
    std::copy(J, J + 6, J_pose);
  }
  if (J_line) {
    const double J[4] = {sign, sign * (pose[0] * s - pose[1] * c), 0.0, 1.0};
    std::copy(J, J + 4, J_line);
  }
}

// Residual (3) of an increment, Jacobians row-major (3x3) by the pose before and after.
inline void odometry_residual(const double* a, const double* b, const double* increment, double* e,
                              double* J_a, double* J_b) {
  const double c = std::cos(a[2]), s = std::sin(a[2]), dx = b[0] - a[0], dy = b[1] - a[1];
  const double x = c * dx + s * dy, y = -s * dx + c * dy;
  e[0] = x - increment[0], e[1] = y - increment[1];
  e[2] = wrap(b[2] - a[2] - increment[2]);
  if (J_a) {
    const double J[9] = {-c, -s, y, s, -c, -x, 0.0, 0.0, -1.0};
    std::copy(J, J + 9, J_a);
  }
  if (J_b) {
    const double J[9] = {c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0};
    std::copy(J, J + 9, J_b);
  }
}

// Residual (3) of the start; its Jacobian is the identity.
inline void start_residual(const double* pose, const double* start, double* e) {
  e[0] = pose[0] - start[0], e[1] = pose[1] - start[1], e[2] = wrap(pose[2] - start[2]);
}

inline double now() {
  using namespace std::chrono;
  return duration<double>(steady_clock::now().time_since_epoch()).count();
}

// Processor time of this process, user and system.
inline double processor() {
  rusage use{};
  getrusage(RUSAGE_SELF, &use);
  return use.ru_utime.tv_sec + use.ru_stime.tv_sec +
         1e-6 * (use.ru_utime.tv_usec + use.ru_stime.tv_usec);
}

// Largest memory of this process so far; getrusage would count the parent's before exec too.
inline double peak_mb() {
  std::ifstream in("/proc/self/status");
  std::string line;
  while (std::getline(in, line))
    if (line.rfind("VmHWM:", 0) == 0) return std::stod(line.substr(6)) / 1024.0;
  return NAN;
}

inline void report(double setup, double solve, double cpu, int iterations, double cost,
                   double base) {
  std::printf(
      "{\"setup_s\": %.6f, \"solve_s\": %.6f, \"cpu_s\": %.6f, \"iterations\": %d, "
      "\"cost\": %.17g, \"memory_mb\": %.1f}\n",
      setup, solve, cpu, iterations, cost, peak_mb() - base);
}
