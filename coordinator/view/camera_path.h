/* Camera paths: key frames from a file, and the frames between them.
 *
 * The file is a table of comma-separated values, as spreadsheets write it. Its first line names the columns, in any
 * order: from.x, from.y, from.z (position of the eye), to.x, to.y, to.z (the point that it looks at), all in m of the
 * world; and, if wanted, field-of-view (vertical, degrees) and time (any unit, increasing). Each further line is a key
 * frame; there are at least two. Empty lines, and lines that begin with #, are left out. Without times the key frames
 * are equally far apart in time.
 *
 * Between key frames each number follows a cubic Hermite curve whose tangent at key frame k is (p[k+1] - p[k-1]) /
 * (t[k+1] - t[k-1]): Catmull, Rom: A Class of Local Interpolating Splines (1974), for unequal time intervals. At the
 * ends the tangent is the slope of the first or last interval; if the last key frame equals the first, it is that of
 * the closed curve. Not collective. */
#ifndef KILN_COORDINATOR_VIEW_CAMERA_PATH_H
#define KILN_COORDINATOR_VIEW_CAMERA_PATH_H

#include <stddef.h>

#include "worker/base/status.h"

struct kiln_camera_frame {
    double from[3], to[3]; /* world, m */
    double field_of_view;  /* degrees, vertical; 0: not given in the file */
};

struct kiln_camera_path;

/* KILN_NO_INPUT; KILN_BAD_INPUT with file, line and what is wrong there. */
int kiln_camera_path_read(struct kiln_camera_path **path, const char *file, struct kiln_error *error);
void kiln_camera_path_destroy(struct kiln_camera_path **path);

/* The number of key frames, at least 2. */
size_t kiln_camera_path_keys(const struct kiln_camera_path *path);

/* Computes frame `index` of `count` frames at equal time steps. The first and the last frame are exactly the first and
 * the last key frame; a count of 1 gives the first. */
void kiln_camera_path_frame(const struct kiln_camera_path *path, size_t index, size_t count,
                            struct kiln_camera_frame *frame);

#endif
