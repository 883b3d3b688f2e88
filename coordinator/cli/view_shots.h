/* Pictures that kiln view has to draw: one; one for each of several cameras; or the frames of a camera path. Private to
 * coordinator/cli. Nothing here is collective. */
#ifndef KILN_COORDINATOR_CLI_VIEW_SHOTS_H
#define KILN_COORDINATOR_CLI_VIEW_SHOTS_H

#include "coordinator/files/publish.h"
#include "coordinator/job/job.h"
#include "coordinator/view/camera_path.h"
#include "coordinator/view/view.h"

enum kiln_shots_kind { KILN_SHOTS_ONE, KILN_SHOTS_CAMERAS, KILN_SHOTS_PATH };

struct kiln_shots {
    enum kiln_shots_kind kind;
    size_t count;
    struct kiln_view_wish *wishes;    /* owned */
    struct kiln_camera_frame *frames; /* eye and target that the wishes point to; owned */
    bool numbered;                    /* file names need numbers, since camera names alone would collide */
    const char *output;               /* path of the picture, or the pattern for several paths; borrowed */
};

/* Makes the list that the job asks for. The job and the scene must outlive it. Release with kiln_shots_destroy, also
 * after a failure. KILN_USAGE for an unknown camera and for options that contradict each other; the statuses of
 * kiln_camera_path_read. */
int kiln_shots_make(const struct kiln_job *job, const struct kiln_scene *scene, const char *output,
                    struct kiln_shots *shots, struct kiln_error *error);
void kiln_shots_destroy(struct kiln_shots *shots);

/* Makes the path of picture `index`. With several pictures it is NAME-CAMERA.png or NAME-0001.png. Characters of a
 * camera's name other than letters, digits, '.', '-' and '_' become '_'. If two pictures would have the same file, all
 * get their number in the list, too: NAME-CAMERA-1.png. KILN_USAGE if it is too long. */
int kiln_shots_path(const struct kiln_shots *shots, const struct kiln_scene *scene, size_t index,
                    char path[KILN_PATH_SIZE], struct kiln_error *error);

#endif
