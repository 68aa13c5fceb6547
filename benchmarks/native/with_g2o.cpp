// The benchmark problem in g2o: analytic Jacobians, Gauss-Newton, one thread. Arguments: problem,
// solver (cholmod, eigen), tolerance.
#include <g2o/core/base_binary_edge.h>
#include <g2o/core/base_unary_edge.h>
#include <g2o/core/base_vertex.h>
#include <g2o/core/block_solver.h>
#include <g2o/core/optimization_algorithm_gauss_newton.h>
#include <g2o/core/sparse_optimizer.h>
#include <g2o/core/sparse_optimizer_terminate_action.h>
#include <g2o/solvers/cholmod/linear_solver_cholmod.h>
#include <g2o/solvers/eigen/linear_solver_eigen.h>

#include <cstdlib>
#include <memory>

#include "problem.hpp"

namespace {

template <int d>
struct Additive final : g2o::BaseVertex<d, Eigen::Matrix<double, d, 1>> {
  void setToOriginImpl() override { this->_estimate.setZero(); }
  void oplusImpl(const double* change) override {
    for (int i = 0; i < d; ++i) this->_estimate[i] += change[i];
    if (d == 3) this->_estimate[2] = wrap(this->_estimate[2]);
  }
  bool read(std::istream&) override { return false; }
  bool write(std::ostream&) const override { return false; }
};
using Pose = Additive<3>;
using Line = Additive<2>;

template <int rows, int columns>
using RowMajor = Eigen::Matrix<double, rows, columns, Eigen::RowMajor>;

struct Sighting final : g2o::BaseBinaryEdge<2, Eigen::Vector2d, Pose, Line> {
  const double* pose() { return static_cast<Pose*>(_vertices[0])->estimate().data(); }
  const double* line() { return static_cast<Line*>(_vertices[1])->estimate().data(); }
  void computeError() override {
    line_residual(pose(), line(), _measurement.data(), _error.data(), nullptr, nullptr);
  }
  void linearizeOplus() override {
    double e[2];
    RowMajor<2, 3> Jp;
    RowMajor<2, 2> Jl;
    line_residual(pose(), line(), _measurement.data(), e, Jp.data(), Jl.data());
    _jacobianOplusXi = Jp;
    _jacobianOplusXj = Jl;
  }
  bool read(std::istream&) override { return false; }
  bool write(std::ostream&) const override { return false; }
};

struct Increment final : g2o::BaseBinaryEdge<3, Eigen::Vector3d, Pose, Pose> {
  const double* pose(int n) { return static_cast<Pose*>(_vertices[n])->estimate().data(); }
  void computeError() override {
    odometry_residual(pose(0), pose(1), _measurement.data(), _error.data(), nullptr, nullptr);
  }
  void linearizeOplus() override {
    double e[3];
    RowMajor<3, 3> Ja, Jb;
    odometry_residual(pose(0), pose(1), _measurement.data(), e, Ja.data(), Jb.data());
    _jacobianOplusXi = Ja;
    _jacobianOplusXj = Jb;
  }
  bool read(std::istream&) override { return false; }
  bool write(std::ostream&) const override { return false; }
};

struct Start final : g2o::BaseUnaryEdge<3, Eigen::Vector3d, Pose> {
  void computeError() override {
    const double* pose = static_cast<Pose*>(_vertices[0])->estimate().data();
    start_residual(pose, _measurement.data(), _error.data());
  }
  void linearizeOplus() override { _jacobianOplusXi.setIdentity(); }
  bool read(std::istream&) override { return false; }
  bool write(std::ostream&) const override { return false; }
};

template <int d>
Eigen::Matrix<double, d, d> information(const double* whitener) {
  const Eigen::Map<const RowMajor<d, d>> W(whitener);
  return W.transpose() * W;
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 4) return 2;
  Problem p = read_problem(arguments[1]);
  const double base = peak_mb(), begin = now(), used = processor();
  using Blocks = g2o::BlockSolverX;
  std::unique_ptr<g2o::LinearSolver<Blocks::PoseMatrixType>> linear;
  if (std::string(arguments[2]) == "eigen") {
    auto solver = std::make_unique<g2o::LinearSolverEigen<Blocks::PoseMatrixType>>();
    solver->setBlockOrdering(true);
    linear = std::move(solver);
  } else {
    auto solver = std::make_unique<g2o::LinearSolverCholmod<Blocks::PoseMatrixType>>();
    solver->setBlockOrdering(true);
    linear = std::move(solver);
  }
  g2o::SparseOptimizer optimizer;
  optimizer.setVerbose(false);
  optimizer.setAlgorithm(
      new g2o::OptimizationAlgorithmGaussNewton(std::make_unique<Blocks>(std::move(linear))));
  for (int64_t i = 0; i < p.nodes; ++i) {
    auto* vertex = new Pose;
    vertex->setId(static_cast<int>(i));
    vertex->setEstimate(Eigen::Map<Eigen::Vector3d>(&p.pose[3 * i]));
    optimizer.addVertex(vertex);
  }
  for (int64_t m = 0; m < p.lines; ++m) {
    auto* vertex = new Line;
    vertex->setId(static_cast<int>(p.nodes + m));
    vertex->setEstimate(Eigen::Map<Eigen::Vector2d>(&p.line[2 * m]));
    optimizer.addVertex(vertex);
  }
  auto* start = new Start;
  start->setVertex(0, optimizer.vertex(0));
  start->setMeasurement(Eigen::Map<Eigen::Vector3d>(p.start.data()));
  start->setInformation(information<3>(p.start_whitener.data()));
  optimizer.addEdge(start);
  for (int64_t i = 0; i + 1 < p.nodes; ++i) {
    auto* edge = new Increment;
    edge->setVertex(0, optimizer.vertex(static_cast<int>(i)));
    edge->setVertex(1, optimizer.vertex(static_cast<int>(i + 1)));
    edge->setMeasurement(Eigen::Map<Eigen::Vector3d>(&p.increment[3 * i]));
    edge->setInformation(information<3>(&p.whitener[9 * i]));
    optimizer.addEdge(edge);
  }
  for (int64_t k = 0; k < p.sightings; ++k) {
    auto* edge = new Sighting;
    edge->setVertex(0, optimizer.vertex(static_cast<int>(p.node[k])));
    edge->setVertex(1, optimizer.vertex(static_cast<int>(p.nodes + p.landmark[k])));
    edge->setMeasurement(Eigen::Map<Eigen::Vector2d>(&p.z[2 * k]));
    edge->setInformation(information<2>(&p.z_whitener[4 * k]));
    optimizer.addEdge(edge);
  }
  optimizer.initializeOptimization();
  const double built = now();
  auto* stop = new g2o::SparseOptimizerTerminateAction;
  stop->setGainThreshold(std::atof(arguments[3]));
  optimizer.addPostIterationAction(stop);
  const int iterations = optimizer.optimize(50);
  const double solved = now(), cpu = processor() - used;
  optimizer.computeActiveErrors();
  report(built - begin, solved - built, cpu, iterations, 0.5 * optimizer.activeChi2(), base);
  return iterations > 0 ? 0 : 1;
}
