#include "coordinator/import/numbers.h"

#include <math.h>

#define ROW(name, key, low, high) {key, low, high},
static const struct kiln_number_range ranges[KILN_NUMBERS] = {KILN_NUMBER_LIST(ROW)};

const struct kiln_number_range *kiln_number_range(enum kiln_number number) { return &ranges[number]; }

bool kiln_number_fits(enum kiln_number number, double value)
{
    return isfinite(value) && value >= ranges[number].low && value <= ranges[number].high;
}
