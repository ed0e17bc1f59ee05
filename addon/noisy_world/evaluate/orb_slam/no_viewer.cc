// SPDX-License-Identifier: GPL-3.0-or-later
// What ORB-SLAM calls of its viewer where none is asked for: the library draws nothing.
#include "Viewer.h"

#if GENERATION == 2
#define SETTINGS_ARGUMENT
using CameraPose = cv::Mat;
using WholeMap = SLAM::Map;
#define MEMBER_MAP mpMap
#else
#define SETTINGS_ARGUMENT , Settings *
using CameraPose = Sophus::SE3f;
using WholeMap = SLAM::Atlas;
#define MEMBER_MAP mpAtlas
#endif

namespace SLAM {
MapDrawer::MapDrawer(WholeMap *map, const std::string & SETTINGS_ARGUMENT) : MEMBER_MAP(map) {}
void MapDrawer::SetCurrentCameraPose(const CameraPose &) {}

Viewer::Viewer(System *, FrameDrawer *, MapDrawer *, Tracking *, const std::string & SETTINGS_ARGUMENT) {}
void Viewer::Run() {}
void Viewer::RequestFinish() {}
void Viewer::RequestStop() {}
void Viewer::Release() {}
bool Viewer::isFinished() { return true; }
bool Viewer::isStopped() { return true; }
}  // namespace SLAM
