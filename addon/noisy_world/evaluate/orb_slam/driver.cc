// SPDX-License-Identifier: GPL-3.0-or-later
// ORB-SLAM2 or ORB-SLAM3 on a sequence, without a window.
//
//   orb_slam VOCABULARY SETTINGS FRAMES OUT
//
// FRAMES: a first line `rgbd|mono DEPTH_SCALE_PER_M GAP_S`, then a line a frame, `STAMP_S<tab>COLOUR<tab>DEPTH`. Writes
// trajectory.txt and keyframes.txt (TUM, camera-to-world, with the stamps as they were given) and frames.csv into OUT.
//
// As programs/orb_slam3.py does: poses are those at the end, as SaveTrajectoryTUM of both has them; and before the next
// frame is shown, the threads that build the map get as much of a processor's time as the camera's rate gives them, or as
// they need.
#include <dirent.h>
#include <sys/syscall.h>
#include <time.h>

#include <algorithm>
#include <fstream>
#include <iostream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include <Eigen/Geometry>
#include <opencv2/opencv.hpp>

#include "System.h"
#include "Tracking.h"

using Pose = Eigen::Isometry3d;

constexpr double QUIET_S = 0.002;  // chosen: the map's threads look for work every 3 and every 5 ms
constexpr int QUIET_TIMES = 3;
constexpr double END_S = 20.0;     // of a processor, for bundle adjustment over the whole map after the last frame
constexpr double PATIENCE = 20.0;  // chosen: how many times as long is waited for a processor that others use

// The tracker keeps each frame's keyframe and motion, but the system that has it keeps it private. An explicit
// instantiation may name private members.
template <class Tag, typename Tag::Member member>
struct Opened {
  friend typename Tag::Member opened(Tag) { return member; }
};
struct TrackerOf {
  using Member = SLAM::Tracking *SLAM::System::*;
  friend Member opened(TrackerOf);
};
template struct Opened<TrackerOf, &SLAM::System::mpTracker>;
#if GENERATION == 2
using WholeMap = SLAM::Map;
#define MEMBER_MAP mpMap
#else
using WholeMap = SLAM::Atlas;
#define MEMBER_MAP mpAtlas
#endif
struct MapOf {
  using Member = WholeMap *SLAM::System::*;
  friend Member opened(MapOf);
};
template struct Opened<MapOf, &SLAM::System::MEMBER_MAP>;

struct Frame {
  std::string stamp_text, colour, depth;
  double stamp_s;
};

struct Sequence {
  bool mono;
  double depth_scale_per_m, gap_s;
  std::vector<Frame> frames;
};

[[noreturn]] void fail(const std::string &problem) {
  std::cerr << "orb_slam: " << problem << std::endl;
  _exit(1);
}

Sequence read_sequence(const char *path) {
  std::ifstream file(path);
  Sequence found;
  std::string line, kind, stamp;
  std::getline(file, line);
  std::istringstream first(line);
  if (!(first >> kind >> found.depth_scale_per_m >> found.gap_s)) fail(std::string(path) + ": is no list of frames");
  found.mono = kind == "mono";
  while (std::getline(file, line)) {
    std::istringstream parts(line);
    Frame frame;
    std::getline(parts, frame.stamp_text, '\t');
    std::getline(parts, frame.colour, '\t');
    std::getline(parts, frame.depth, '\t');
    frame.stamp_s = std::stod(frame.stamp_text);
    found.frames.push_back(frame);
  }
  if (found.frames.empty()) fail(std::string(path) + ": names no frames");
  return found;
}

cv::Mat read_image(const std::string &path, int mode) {
  cv::Mat image = cv::imread(path, mode);
  if (image.empty()) fail(path + ": is no image");
  return image;
}

double clock_s(clockid_t which) {
  timespec now;
  clock_gettime(which, &now);
  return now.tv_sec + 1e-9 * now.tv_nsec;
}

// Seconds of a processor that the other threads have had.
double others_s() { return clock_s(CLOCK_PROCESS_CPUTIME_ID) - clock_s(CLOCK_THREAD_CPUTIME_ID); }

// Whether another thread is running, or would if it had a processor.
bool others_are_busy() {
  const std::string own = std::to_string(syscall(SYS_gettid));
  bool busy = false;
  if (DIR *tasks = opendir("/proc/self/task")) {
    while (dirent *task = readdir(tasks)) {
      const std::string name = task->d_name;
      if (name[0] == '.' || name == own) continue;
      std::ifstream file("/proc/self/task/" + name + "/stat");
      std::string stat((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
      const size_t end = stat.rfind(") ");
      if (end != std::string::npos && (stat[end + 2] == 'R' || stat[end + 2] == 'D')) busy = true;
    }
    closedir(tasks);
  }
  return busy;
}

// Wait until the other threads have had a time of a processor since they had begun_s, or have nothing to do.
void settle(double begun_s, double period_s) {
  const double until_s = clock_s(CLOCK_MONOTONIC) + PATIENCE * period_s;
  int quiet = 0;
  while (quiet < QUIET_TIMES && others_s() < begun_s + period_s && clock_s(CLOCK_MONOTONIC) < until_s) {
    usleep(static_cast<useconds_t>(1e6 * QUIET_S));
    quiet = others_are_busy() ? 0 : quiet + 1;
  }
}

std::string state_name(int state) {
  if (state == SLAM::Tracking::OK) return "tracked";
#if GENERATION == 3
  if (state == SLAM::Tracking::RECENTLY_LOST) return "lost";
#endif
  return state == SLAM::Tracking::LOST ? "lost" : "not_initialised";
}

#if GENERATION == 2
Pose pose_of(const cv::Mat &matrix) {
  Pose pose = Pose::Identity();
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 4; ++column) pose.matrix()(row, column) = matrix.at<float>(row, column);
  return pose;
}
#else
Pose pose_of(const Sophus::SE3f &pose) { return Pose(pose.matrix().cast<double>()); }
#endif

std::string tum_line(const Frame &frame, const Pose &c2w) {
  const Eigen::Quaterniond turn = Eigen::Quaterniond(c2w.rotation()).normalized();
  const Eigen::Vector3d at = c2w.translation();
  std::ostringstream line;
  line.precision(17);
  line << frame.stamp_text << ' ' << at.x() << ' ' << at.y() << ' ' << at.z() << ' ' << turn.x() << ' ' << turn.y() << ' '
       << turn.z() << ' ' << turn.w() << '\n';
  return line.str();
}

void write_text(const std::string &path, const std::string &text) {
  std::ofstream file(path);
  file << text;
  file.close();
  if (!file) fail(path + ": cannot be written");
}

// Keyframes and tracked frames as SaveKeyFrameTrajectoryTUM and SaveTrajectoryTUM find them: a frame stands relative to
// its keyframe or, where that was removed, to the one which that stands relative to.
void write_poses(SLAM::System &system, const Sequence &sequence, const std::string &out) {
  std::map<double, const Frame *> by_time_s;
  for (const Frame &frame : sequence.frames) by_time_s[frame.stamp_s - sequence.frames[0].stamp_s] = &frame;
  std::vector<SLAM::KeyFrame *> keyframes = (system.*opened(MapOf()))->GetAllKeyFrames();
  std::sort(keyframes.begin(), keyframes.end(), SLAM::KeyFrame::lId);
  std::string frames_text, keyframes_text;
  if (!keyframes.empty()) {
    const Pose world = pose_of(keyframes[0]->GetPose()).inverse();
    for (SLAM::KeyFrame *keyframe : keyframes) {
      if (keyframe->isBad()) continue;
      const Pose w2c = pose_of(keyframe->GetPose()) * world;
      keyframes_text += tum_line(*by_time_s.at(keyframe->mTimeStamp), w2c.inverse());
    }
    SLAM::Tracking &tracker = *(system.*opened(TrackerOf()));
    auto reference = tracker.mlpReferences.begin();
    auto time_s = tracker.mlFrameTimes.begin();
    auto lost = tracker.mlbLost.begin();
    for (auto motion = tracker.mlRelativeFramePoses.begin(); motion != tracker.mlRelativeFramePoses.end();
         ++motion, ++reference, ++time_s, ++lost) {
      SLAM::KeyFrame *keyframe = *reference;
      if (*lost || !keyframe) continue;
      Pose from_keyframe = pose_of(*motion);
      while (keyframe && keyframe->isBad()) {
        from_keyframe = from_keyframe * pose_of(keyframe->mTcp);
        keyframe = keyframe->GetParent();
      }
      if (!keyframe) continue;
      const Pose w2c = from_keyframe * pose_of(keyframe->GetPose()) * world;
      frames_text += tum_line(*by_time_s.at(*time_s), w2c.inverse());
    }
  }
  write_text(out + "/trajectory.txt", frames_text);
  write_text(out + "/keyframes.txt", keyframes_text);
}

void run(SLAM::System &system, const Sequence &sequence, const std::string &out) {
  std::ostringstream rows;
  rows << "index,stamp_s,state,features,matched,tracking_s\n";
  for (size_t index = 0; index < sequence.frames.size(); ++index) {
    const Frame &frame = sequence.frames[index];
    cv::Mat colour, depth_m;
    cv::cvtColor(read_image(frame.colour, cv::IMREAD_COLOR), colour, cv::COLOR_BGR2RGB);
    if (!sequence.mono)
      read_image(frame.depth, cv::IMREAD_UNCHANGED).convertTo(depth_m, CV_32F, 1.0 / sequence.depth_scale_per_m);
    const double since_s = frame.stamp_s - sequence.frames[0].stamp_s;
    const double begun_s = others_s(), tracking_s = clock_s(CLOCK_THREAD_CPUTIME_ID);
    if (sequence.mono)
      system.TrackMonocular(colour, since_s);
    else
      system.TrackRGBD(colour, depth_m, since_s);
    const double took_s = clock_s(CLOCK_THREAD_CPUTIME_ID) - tracking_s;
    settle(begun_s, sequence.gap_s);
    const auto points = system.GetTrackedMapPoints();
    rows << index << ',' << frame.stamp_text << ',' << state_name(system.GetTrackingState()) << ','
         << system.GetTrackedKeyPointsUn().size() << ','
         << points.size() - std::count(points.begin(), points.end(), static_cast<SLAM::MapPoint *>(nullptr)) << ','
         << took_s << '\n';
  }
  settle(others_s(), END_S);
  write_text(out + "/frames.csv", rows.str());
  write_poses(system, sequence, out);
}

int main(int count, char **arguments) {
  if (count != 5) fail("VOCABULARY, SETTINGS, FRAMES and OUT are needed");
  cv::setNumThreads(1);
  const Sequence sequence = read_sequence(arguments[3]);
  SLAM::System system(arguments[1], arguments[2], sequence.mono ? SLAM::System::MONOCULAR : SLAM::System::RGBD, false);
  run(system, sequence, arguments[4]);
  std::cout.flush();
  _exit(0);  // its threads have no end; what it found is written
}
