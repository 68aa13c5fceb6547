// The benchmark problem in Ceres: analytic Jacobians, one thread. Arguments: problem, solver
// (normal, schur), tolerance.
#include <ceres/ceres.h>

#include <cstdlib>

#include "problem.hpp"

namespace {

// out = W * in for row-major (d x d) and (d x n)
template <int d, int n>
void whiten(const double* W, const double* in, double* out) {
  for (int i = 0; i < d; ++i)
    for (int j = 0; j < n; ++j) {
      double sum = 0.0;
      for (int k = 0; k <= i; ++k) sum += W[d * i + k] * in[n * k + j];
      out[n * i + j] = sum;
    }
}

struct Sighting final : ceres::SizedCostFunction<2, 3, 2> {
  const double *z, *W;
  Sighting(const double* z_, const double* W_) : z(z_), W(W_) {}
  bool Evaluate(double const* const* x, double* e, double** J) const override {
    double r[2], Jp[6], Jl[4];
    line_residual(x[0], x[1], z, r, J && J[0] ? Jp : nullptr, J && J[1] ? Jl : nullptr);
    whiten<2, 1>(W, r, e);
    if (J && J[0]) whiten<2, 3>(W, Jp, J[0]);
    if (J && J[1]) whiten<2, 2>(W, Jl, J[1]);
    return true;
  }
};

struct Increment final : ceres::SizedCostFunction<3, 3, 3> {
  const double *u, *W;
  Increment(const double* u_, const double* W_) : u(u_), W(W_) {}
  bool Evaluate(double const* const* x, double* e, double** J) const override {
    double r[3], Ja[9], Jb[9];
    odometry_residual(x[0], x[1], u, r, J && J[0] ? Ja : nullptr, J && J[1] ? Jb : nullptr);
    whiten<3, 1>(W, r, e);
    if (J && J[0]) whiten<3, 3>(W, Ja, J[0]);
    if (J && J[1]) whiten<3, 3>(W, Jb, J[1]);
    return true;
  }
};

struct Start final : ceres::SizedCostFunction<3, 3> {
  const double *pose, *W;
  Start(const double* pose_, const double* W_) : pose(pose_), W(W_) {}
  bool Evaluate(double const* const* x, double* e, double** J) const override {
    double r[3];
    start_residual(x[0], pose, r);
    whiten<3, 1>(W, r, e);
    if (J && J[0]) std::copy(W, W + 9, J[0]);
    return true;
  }
};

}  // namespace

int main(int count, char** arguments) {
  if (count != 4) return 2;
  Problem p = read_problem(arguments[1]);
  const double base = peak_mb(), begin = now(), used = processor();
  ceres::Problem problem;
  problem.AddResidualBlock(new Start(p.start.data(), p.start_whitener.data()), nullptr,
                           p.pose.data());
  for (int64_t i = 0; i + 1 < p.nodes; ++i)
    problem.AddResidualBlock(new Increment(&p.increment[3 * i], &p.whitener[9 * i]), nullptr,
                             &p.pose[3 * i], &p.pose[3 * i + 3]);
  for (int64_t k = 0; k < p.sightings; ++k)
    problem.AddResidualBlock(new Sighting(&p.z[2 * k], &p.z_whitener[4 * k]), nullptr,
                             &p.pose[3 * p.node[k]], &p.line[2 * p.landmark[k]]);
  ceres::Solver::Options options;
  options.sparse_linear_algebra_library_type = ceres::SUITE_SPARSE;
  options.linear_solver_type = std::string(arguments[2]) == "schur"
                                   ? ceres::SPARSE_SCHUR
                                   : ceres::SPARSE_NORMAL_CHOLESKY;
  options.initial_trust_region_radius = 1e16;  // plain Gauss-Newton unless a step fails
  options.max_trust_region_radius = 1e20;
  options.function_tolerance = std::atof(arguments[3]);
  options.gradient_tolerance = 0.0;
  options.parameter_tolerance = 0.0;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  const double built = now();
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  report(built - begin, now() - built, processor() - used,
         static_cast<int>(summary.iterations.size()) - 1, summary.final_cost, base);
  return summary.IsSolutionUsable() ? 0 : 1;
}
