// Odometry by PCL's registrations, each scan aligned to the one before it, as a peer for `python -m bench.mapping`.
//
// scan_to_scan DIR METHOD VOXEL_M MIN_RANGE_M MAX_RANGE_M [GUESSES]
//
// DIR holds data0.pcd, data1.pcd, ...; METHOD is icp, icp_plane or gicp, with PCL's own defaults. GUESSES: a text file
// with a line a scan of 16 numbers, the row-major T_previous_scan to begin from; without it each begins from identity.
// A JSON line a scan: its pose in the first scan's frame (row-major), and the wall and CPU milliseconds of range gate,
// voxel filter, normals and registration. Reading files is not timed.

#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include <pcl/features/normal_3d.h>
#include <pcl/filters/voxel_grid.h>
#include <pcl/io/pcd_io.h>
#include <pcl/pcl_config.h>
#include <pcl/registration/gicp.h>
#include <pcl/registration/icp.h>

namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;
using NormalCloud = pcl::PointCloud<pcl::PointNormal>;

constexpr int kNumNeighbours = 10;

struct Filter {
  float voxel_m;
  float min_range_m;
  float max_range_m;

  Cloud::Ptr operator()(const Cloud& scan) const {
    Cloud::Ptr near(new Cloud);
    for (const auto& point : scan) {
      const float range_m = point.getVector3fMap().norm();
      if (range_m >= min_range_m && range_m <= max_range_m) near->push_back(point);
    }
    Cloud::Ptr thin(new Cloud);
    pcl::VoxelGrid<pcl::PointXYZ> grid;
    grid.setLeafSize(voxel_m, voxel_m, voxel_m);
    grid.setInputCloud(near);
    grid.filter(*thin);
    return thin;
  }
};

NormalCloud::Ptr with_normals(const Cloud::Ptr& cloud) {
  pcl::NormalEstimation<pcl::PointXYZ, pcl::PointNormal> estimation;
  estimation.setInputCloud(cloud);
  estimation.setKSearch(kNumNeighbours);
  NormalCloud::Ptr normals(new NormalCloud);
  estimation.compute(*normals);
  pcl::copyPointCloud(*cloud, *normals);
  return normals;
}

// Keeps the last scan as the target of the next.
class Odometry {
 public:
  virtual ~Odometry() = default;
  virtual Eigen::Matrix4f step(const Cloud::Ptr& scan, const Eigen::Matrix4f& guess) = 0;
};

template <typename Registration, typename CloudType, typename Prepare>
class PairwiseOdometry : public Odometry {
 public:
  explicit PairwiseOdometry(Prepare prepare) : prepare_(prepare) {}

  Eigen::Matrix4f step(const Cloud::Ptr& scan, const Eigen::Matrix4f& guess) override {
    const auto source = prepare_(scan);
    Eigen::Matrix4f T_previous_scan = Eigen::Matrix4f::Identity();
    if (target_) {
      Registration registration;
      registration.setInputSource(source);
      registration.setInputTarget(target_);
      CloudType aligned;
      registration.align(aligned, guess);
      T_previous_scan = registration.getFinalTransformation();
    }
    target_ = source;
    return T_previous_scan;
  }

 private:
  Prepare prepare_;
  typename CloudType::Ptr target_;
};

template <typename Registration, typename CloudType, typename Prepare>
std::unique_ptr<Odometry> pairwise(Prepare prepare) {
  return std::make_unique<PairwiseOdometry<Registration, CloudType, Prepare>>(prepare);
}

std::unique_ptr<Odometry> make_odometry(const std::string& method) {
  const auto as_it_is = [](const Cloud::Ptr& cloud) { return cloud; };
  if (method == "icp") return pairwise<pcl::IterativeClosestPoint<pcl::PointXYZ, pcl::PointXYZ>, Cloud>(as_it_is);
  if (method == "icp_plane")
    return pairwise<pcl::IterativeClosestPointWithNormals<pcl::PointNormal, pcl::PointNormal>, NormalCloud>(
        with_normals);
  if (method == "gicp")
    return pairwise<pcl::GeneralizedIterativeClosestPoint<pcl::PointXYZ, pcl::PointXYZ>, Cloud>(as_it_is);
  return nullptr;
}

std::vector<Cloud::Ptr> read_scans(const std::filesystem::path& directory) {
  std::vector<Cloud::Ptr> scans;
  for (;;) {
    const auto path = directory / ("data" + std::to_string(scans.size()) + ".pcd");
    if (!std::filesystem::exists(path)) return scans;
    Cloud::Ptr scan(new Cloud);
    if (pcl::io::loadPCDFile(path.string(), *scan) != 0) return {};
    scans.push_back(scan);
  }
}

std::vector<Eigen::Matrix4f> read_guesses(const char* path, std::size_t num_scans) {
  std::vector<Eigen::Matrix4f> guesses(num_scans, Eigen::Matrix4f::Identity());
  if (path == nullptr) return guesses;
  std::ifstream file(path);
  for (auto& guess : guesses)
    for (int i = 0; i < 16; ++i) file >> guess(i / 4, i % 4);
  return file ? guesses : std::vector<Eigen::Matrix4f>{};
}

// Rounding of float32 products leaves the group of rotations: the nearest rotation is kept.
Eigen::Matrix4d with_nearest_rotation(Eigen::Matrix4d T) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(T.topLeftCorner<3, 3>(), Eigen::ComputeFullU | Eigen::ComputeFullV);
  T.topLeftCorner<3, 3>() = svd.matrixU() * svd.matrixV().transpose();
  return T;
}

void print_line(const Eigen::Matrix4d& pose, double ms, double cpu_ms) {
  std::printf("{\"ms\": %.4f, \"cpu_ms\": %.4f, \"pose\": [", ms, cpu_ms);
  for (int i = 0; i < 16; ++i) std::printf(i == 0 ? "%.17g" : ", %.17g", pose(i / 4, i % 4));
  std::printf("]}\n");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && std::string(argv[1]) == "--version") {
    std::printf("PCL %s\n", PCL_VERSION_PRETTY);
    return 0;
  }
  const auto odometry = argc < 6 ? nullptr : make_odometry(argv[2]);
  if (odometry == nullptr) {
    std::cerr << "usage: scan_to_scan DIR icp|icp_plane|gicp VOXEL_M MIN_RANGE_M MAX_RANGE_M [GUESSES]\n";
    return 2;
  }
  const Filter filter{std::stof(argv[3]), std::stof(argv[4]), std::stof(argv[5])};
  const auto scans = read_scans(argv[1]);
  const auto guesses = read_guesses(argc > 6 ? argv[6] : nullptr, scans.size());
  if (scans.empty() || guesses.empty()) {
    std::cerr << argv[1] << ": scans or guesses cannot be read\n";
    return 1;
  }
  Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const auto started = std::chrono::steady_clock::now();
    const auto cpu_started = std::clock();
    const Eigen::Matrix4f T_previous_scan = odometry->step(filter(*scans[i]), guesses[i]);
    const double cpu_ms = 1e3 * static_cast<double>(std::clock() - cpu_started) / CLOCKS_PER_SEC;
    const std::chrono::duration<double, std::milli> wall = std::chrono::steady_clock::now() - started;
    pose = with_nearest_rotation(pose * T_previous_scan.cast<double>());
    print_line(pose, wall.count(), cpu_ms);
  }
}
