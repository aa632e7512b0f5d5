#include "catch.hpp"
#include "optimize/reference.hpp"

#include "lumo/optimize/log_nehvi.hpp"

using namespace lumo;

namespace {

template <CovarianceKernel Kernel> void check_regression(const nlohmann::json& c) {
  const Eigen::Index d = Eigen::Index(c["x"][0].size());
  const TrainingData data{columns(c["x"], d), vector(c["y"]), Eigen::VectorXd::Zero(d), Eigen::VectorXd::Ones(d)};
  const Hyperparameters h{vector(c["length_scale"]), c["noise"], c["mean"]};
  const GaussianProcess<Kernel> gp(data, h);
  CHECK(gp.jitter() == 0.0);
  CHECK(gp.objective() == Approx(c["objective"].get<double>()).epsilon(1e-9));

  const Eigen::VectorXd y = (data.y.array() - gp.output_mean()) / gp.output_scale();
  const auto value = MarginalLikelihood<Kernel>(data.x, y, Kernel{}, HyperparameterPrior::for_dimension(d))(h);
  CHECK(value.mean == Approx(h.mean).epsilon(1e-8));
  CHECK(value.log_likelihood == Approx(c["log_likelihood"].get<double>()).epsilon(1e-9));
  CHECK((value.gradient - vector(c["gradient"])).norm() < 1e-7 * vector(c["gradient"]).norm());

  const Eigen::MatrixXd test = columns(c["test"], d);
  const auto p = gp.predict(test);
  const double scale = gp.output_scale();
  CHECK((p.mean - vector(c["posterior_mean"])).norm() < 1e-9 * scale);
  CHECK((p.variance - columns(c["posterior_covariance"], test.cols()).diagonal()).norm() <
        1e-9 * scale * scale);  // where the peer does not clamp at 1e-10
  CHECK((gp.mean(test) - p.mean).norm() < 1e-9 * scale);
  CHECK((gp.covariance(test, test) - columns(c["posterior_covariance"], test.cols())).norm() < 1e-8 * scale * scale);

  // At least as good a maximum; where it is the same one, the same hyper-parameters.
  const auto fitted = GaussianProcess<Kernel>::fit(data);
  const auto& peer = c["fitted"];
  CHECK(fitted.converged());
  CHECK(fitted.objective() >= peer["objective"].get<double>() - 1e-6);
  if (fitted.objective() < peer["objective"].get<double>() + 1e-5) {
    for (Eigen::Index j = 0; j < d; ++j)
      CHECK(std::log(fitted.hyperparameters().length_scale[j]) ==
            Approx(std::log(peer["length_scale"][std::size_t(j)].get<double>())).margin(0.02));
    CHECK(std::log(fitted.hyperparameters().noise) == Approx(std::log(peer["noise"].get<double>())).margin(0.05));
    CHECK((fitted.mean(test) - vector(peer["posterior_mean"])).norm() < 0.01 * scale);
  }
}

}  // namespace

TEST_CASE("regression agrees with BoTorch", "[reference]") {
  for (const auto& c : reference()["regression"]) {
    INFO(c["name"].get<std::string>());
    if (c["kernel"] == "rbf") check_regression<RbfKernel>(c);
    else check_regression<Matern52Kernel>(c);
  }
}

TEST_CASE("hypervolumes agree with BoTorch", "[reference]") {
  for (const auto& c : reference()["hypervolume"]) {
    const Eigen::VectorXd point = vector(c["reference"]);
    CHECK(hypervolume(columns(c["y"], point.size()), point) == Approx(c["hypervolume"].get<double>()).epsilon(1e-12));
  }
}

TEST_CASE("qLogEHVI and qLogNEHVI agree with BoTorch on the same base samples", "[reference]") {
  for (const auto& c : reference()["acquisition"]) {
    INFO(c["name"].get<std::string>());
    Evidence e;
    e.x = columns(c["x"], 2);
    e.outputs = columns(c["y"], 2);
    e.pending = columns(c["pending"], 2);
    e.lower = Eigen::VectorXd::Zero(2);
    e.upper = Eigen::VectorXd::Ones(2);
    e.reference = vector(c["reference"]);
    std::vector<GaussianProcess<RbfKernel>> models;
    for (int j = 0; j < 2; ++j)
      models.emplace_back(TrainingData{e.x, e.outputs.row(j).transpose(), e.lower, e.upper},
          Hyperparameters{
              vector(c["length_scale"][std::size_t(j)]), c["noise"][std::size_t(j)], c["mean"][std::size_t(j)]});

    const auto& normals = c["normals"];  // draws × (base points, then the candidate) × outputs
    const std::size_t draws = normals.size(), base = normals[0].size() - 1;
    QLogNehvi::BaseSamples samples;
    for (std::size_t j = 0; j < 2; ++j) {
      samples.base.emplace_back(base, draws);
      samples.candidate.emplace_back(draws);
      for (std::size_t s = 0; s < draws; ++s) {
        for (std::size_t i = 0; i < base; ++i) samples.base[j](Eigen::Index(i), Eigen::Index(s)) = normals[s][i][j];
        samples.candidate[j][Eigen::Index(s)] = normals[s][base][j];
      }
    }
    const QLogNehvi config{.noisy = c["noisy"], .tau_relu = c["tau_relu"], .tau_max = c["tau_max"]};
    const QLogNehvi::Prepared<RbfKernel, EachOutput> acquisition(config, models, EachOutput{}, e, samples);
    const Eigen::VectorXd values = acquisition(columns(c["candidates"], 2)), peer = vector(c["values"]);
    for (Eigen::Index i = 0; i < values.size(); ++i) CHECK(values[i] == Approx(peer[i]).epsilon(1e-7).margin(1e-6));
  }
}
