// SPDX-License-Identifier: GPL-3.0-or-later
// What nearly every file of ORB-SLAM reads, compiled once. unistd.h is what Pangolin's headers bring in.
#include <unistd.h>

#include <iostream>
#include <list>
#include <map>
#include <mutex>
#include <set>
#include <thread>
#include <vector>

#include <Eigen/Dense>
#include <Eigen/Sparse>
#include <Eigen/StdVector>

#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/highgui.hpp>
#include <opencv2/imgproc.hpp>

#if GENERATION == 2
#include <opencv2/core/core_c.h>  // its solvers are written in OpenCV's C, which OpenCV 4 still has
#else
#include <boost/serialization/export.hpp>
#include <boost/serialization/list.hpp>
#include <boost/serialization/map.hpp>
#include <boost/serialization/vector.hpp>
#endif
