/* Pictures of what has no colour: false colours with a scale, places as red, green and blue, and colours with a key.
 * Under the picture stands a strip with the scale and its numbers, or the key, where the picture is at least
 * KILN_LEGEND_LEAST pixels wide: KILN_LEGEND_HEIGHT pixels high, twice that below pictures of 800 pixels or more.
 * Nothing here is collective. */
#ifndef KILN_COORDINATOR_VIEW_FALSE_COLOR_H
#define KILN_COORDINATOR_VIEW_FALSE_COLOR_H

#include "coordinator/view/view.h"

enum { KILN_LEGEND_LEAST = 160, KILN_LEGEND_HEIGHT = 44 };

/* Sets low and high of a picture by its finite values, of KILN_FIELD_SCALE those from 0 on: of KILN_FIELD_SCALE those
 * that 0.5 % of the pixels lie below and above, the same for R, G, B; of KILN_FIELD_PLACE the least and the most of
 * each. All 0 without such values. KILN_SYSTEM.
 */
int kiln_false_color_fit(struct kiln_picture *picture, struct kiln_error *error);

/* Publishes a picture of these two meanings, or with a key, as PNG at the destination (publish.h). Without a value:
 * grey; below 0 on a scale: orange, which marks one. */
int kiln_false_color_write(const char *directory, const char *name, const struct kiln_picture *picture,
                           const char *description, struct kiln_error *error);

#endif
