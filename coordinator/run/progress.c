#include "coordinator/run/progress.h"

#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

#include "worker/base/memory.h"
#include "worker/base/text.h"

#define REDRAW_SECONDS 0.1
#define LINE_SECONDS 9.0        /* checked once a second, so a line appears at least every ten seconds */
#define RATE_MEMORY_SECONDS 5.0 /* time constant of the smoothed rate */

struct kiln_progress {
    FILE *stream;
    bool terminal, running, drawn;
    int columns;
    double (*clock)(void *);
    void *clock_data;
    char name[64];
    uint64_t total, done;
    double phase_start;
    double last_shown; /* when a line was last printed or redrawn */
    double rate;       /* units a second, smoothed; 0: unknown */
    double rate_time;
    uint64_t rate_done;
    struct kiln_time_left whole;
    kiln_progress_reckoning reckoning; /* of the stage under way; NULL: it is told by its phase */
    void *reckoning_data;
    double reckoned; /* when it was last asked */
    kiln_progress_watch watch;
    void *watch_data;
    /* protects everything above */
    pthread_mutex_t mutex;
    pthread_cond_t wake;
    pthread_t thread;
    bool thread_runs, leave;
};

static double monotonic(void *unused)
{
    (void)unused;
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + (double)now.tv_nsec * 1e-9;
}

char *kiln_duration_text(double seconds, char *text, size_t size)
{
    if (seconds < 0)
        seconds = 0;
    if (seconds < 9.995)
        (void)snprintf(text, size, "%.2f s", seconds);
    else if (seconds < 99.95)
        (void)snprintf(text, size, "%.1f s", seconds);
    else if (seconds < 3599.5)
        (void)snprintf(text, size, "%d min %02d s", (int)(seconds + 0.5) / 60, (int)(seconds + 0.5) % 60);
    else if (seconds < 1e9)
        (void)snprintf(text, size, "%lld h %02lld min", (long long)(seconds / 60 + 0.5) / 60,
                       (long long)(seconds / 60 + 0.5) % 60);
    else
        (void)snprintf(text, size, "more than 30 years");
    return text;
}

/* Seconds left of the present phase by its own rate; -1: unknown. */
static double left_of_phase(const struct kiln_progress *progress)
{
    return progress->total > 0 && progress->rate > 0 ? (double)(progress->total - progress->done) / progress->rate
                                                     : -1.0;
}

/* Fraction of the present phase that is done; -1: unknown. */
static double share_of_phase(const struct kiln_progress *progress)
{
    return progress->total > 0 ? (double)progress->done / (double)progress->total : -1.0;
}

static struct kiln_progress_state state_of(struct kiln_progress *progress, double now)
{
    struct kiln_progress_state state = {.phase = progress->name, .phase_share = share_of_phase(progress)};
    const bool whole = progress->whole.count > 0;
    kiln_time_left_update(&progress->whole, now);
    state.share = whole ? progress->whole.whole_share : state.phase_share;
    state.left = whole ? progress->whole.whole_left : left_of_phase(progress);
    return state;
}

/* Formats "42 %, 12.3 s left"; if the share is unknown, the time since the phase began, from a second on. */
static void state_text(const struct kiln_progress *progress, const struct kiln_progress_state *state, double now,
                       char *text, size_t size)
{
    char duration[48];
    text[0] = '\0';
    if (state->share < 0.0) {
        if (now - progress->phase_start >= 1.0)
            (void)kiln_duration_text(now - progress->phase_start, text, size);
        return;
    }
    const int used = snprintf(text, size, "%3.0f %%", floor(100.0 * state->share + 1e-9));
    if (state->left > 0.0 && state->share < 1.0)
        (void)snprintf(text + used, size - (size_t)used, ", %s left",
                       kiln_duration_text(state->left, duration, sizeof duration));
}

static void draw_bar(const struct kiln_progress *progress, const struct kiln_progress_state *state, double now)
{
    enum { NAME = 34, LONGEST_BAR = 40 };
    char text[96], name[NAME + 1], bar[LONGEST_BAR + 1] = "";
    state_text(progress, state, now, text, sizeof text);
    int width = progress->columns - NAME - 6 - (int)strlen(text);
    width = width > LONGEST_BAR ? LONGEST_BAR : width;
    if (state->share >= 0.0 && width >= 8) {
        const int filled = (int)(state->share * width);
        for (int i = 0; i < width; i++)
            bar[i] = i < filled ? '#' : '.';
        (void)fprintf(progress->stream, "\r\033[K%-*.*s [%.*s] %s", NAME, NAME, progress->name, width, bar, text);
    } else {
        const int room = progress->columns - 1;
        (void)snprintf(name, sizeof name, "%.*s", NAME, progress->name);
        (void)fprintf(progress->stream, "\r\033[K%.*s %.*s", room / 2, name, room / 2 - 1, text);
    }
    (void)fflush(progress->stream);
}

/* Tells the observer, and shows what is due. */
static void show(struct kiln_progress *progress, double now)
{
    const struct kiln_progress_state state = state_of(progress, now);
    if (progress->watch != NULL)
        progress->watch(progress->watch_data, &state);
    if (progress->stream == NULL || now - progress->last_shown < (progress->terminal ? REDRAW_SECONDS : LINE_SECONDS))
        return;
    progress->last_shown = now;
    if (progress->terminal) {
        draw_bar(progress, &state, now);
        progress->drawn = true;
        return;
    }
    char text[96];
    state_text(progress, &state, now, text, sizeof text);
    const char *told = text + strspn(text, " ");
    (void)fprintf(progress->stream, "%s%s%s\n", progress->name, told[0] != '\0' ? ": " : "", told);
    (void)fflush(progress->stream);
}

/* ---- the display thread ---- */

/* Redraws the phase even if it has reported nothing or waits for other ranks. The caller holds the mutex. */
static void show_again(struct kiln_progress *progress)
{
    if (progress->running)
        show(progress, progress->clock(progress->clock_data));
}

static void *beat(void *data)
{
    struct kiln_progress *progress = data;
    (void)pthread_mutex_lock(&progress->mutex);
    while (!progress->leave) {
        struct timespec until;
        (void)clock_gettime(CLOCK_REALTIME, &until);
        until.tv_sec += 1;
        (void)pthread_cond_timedwait(&progress->wake, &progress->mutex, &until);
        if (!progress->leave)
            show_again(progress);
    }
    (void)pthread_mutex_unlock(&progress->mutex);
    return NULL;
}

/* The thread blocks all signals, so that the main thread gets them. If it cannot start, fewer lines are printed. */
static void start_thread(struct kiln_progress *progress)
{
    sigset_t all, before;
    (void)sigfillset(&all);
    (void)pthread_sigmask(SIG_SETMASK, &all, &before);
    progress->thread_runs = pthread_create(&progress->thread, NULL, beat, progress) == 0;
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
}

static void stop_thread(struct kiln_progress *progress)
{
    if (!progress->thread_runs)
        return;
    (void)pthread_mutex_lock(&progress->mutex);
    progress->leave = true;
    (void)pthread_cond_signal(&progress->wake);
    (void)pthread_mutex_unlock(&progress->mutex);
    (void)pthread_join(progress->thread, NULL);
    progress->thread_runs = false;
}

void kiln_progress_beat(struct kiln_progress *progress)
{
    (void)pthread_mutex_lock(&progress->mutex);
    show_again(progress);
    (void)pthread_mutex_unlock(&progress->mutex);
}

/* ---- create and destroy ---- */

/* No phase is shown any more. */
static void end_line(struct kiln_progress *progress)
{
    progress->running = false;
    if (!progress->drawn)
        return;
    (void)fprintf(progress->stream, "\r\033[K");
    (void)fflush(progress->stream);
    progress->drawn = false;
}

struct kiln_progress *kiln_progress_create_on(FILE *stream, bool terminal, int columns, double (*clock)(void *),
                                              void *clock_data)
{
    struct kiln_progress *progress = NULL;
    if (kiln_allocate(&progress, 1, sizeof *progress, "the progress line", NULL) != 0)
        return NULL;
    progress->stream = stream;
    progress->terminal = terminal;
    progress->columns = columns < 20 ? 20 : columns;
    progress->clock = clock;
    progress->clock_data = clock_data;
    progress->last_shown = -1e300;
    kiln_time_left_begin(&progress->whole, clock(clock_data));
    (void)pthread_mutex_init(&progress->mutex, NULL);
    (void)pthread_cond_init(&progress->wake, NULL);
    return progress;
}

struct kiln_progress *kiln_progress_create(bool quiet, int rank)
{
    if (quiet || rank != 0)
        return NULL;
    const bool terminal = isatty(STDERR_FILENO) == 1;
    struct winsize size = {0};
    const bool known = terminal && ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
    struct kiln_progress *progress =
        kiln_progress_create_on(stderr, terminal, known ? size.ws_col : 80, monotonic, NULL);
    if (progress != NULL)
        start_thread(progress);
    return progress;
}

struct kiln_progress *kiln_progress_create_silent(void)
{
    return kiln_progress_create_on(NULL, false, 80, monotonic, NULL);
}

void kiln_progress_observe(struct kiln_progress *progress, kiln_progress_watch watch, void *data)
{
    if (progress == NULL)
        return;
    (void)pthread_mutex_lock(&progress->mutex);
    progress->watch = watch;
    progress->watch_data = data;
    (void)pthread_mutex_unlock(&progress->mutex);
}

void kiln_progress_destroy(struct kiln_progress **progress)
{
    if (*progress == NULL)
        return;
    stop_thread(*progress);
    end_line(*progress);
    (void)pthread_cond_destroy(&(*progress)->wake);
    (void)pthread_mutex_destroy(&(*progress)->mutex);
    kiln_free(progress);
}

/* ---- stages and phases ---- */

void kiln_progress_expect(struct kiln_progress *progress, const struct kiln_stage *stages, size_t count)
{
    if (progress == NULL)
        return;
    (void)pthread_mutex_lock(&progress->mutex);
    kiln_time_left_expect(&progress->whole, stages, count, progress->clock(progress->clock_data));
    (void)pthread_mutex_unlock(&progress->mutex);
}

void kiln_progress_reckon(struct kiln_progress *progress, kiln_progress_reckoning reckoning, void *data)
{
    if (progress == NULL)
        return;
    (void)pthread_mutex_lock(&progress->mutex);
    progress->reckoning = reckoning;
    progress->reckoning_data = data;
    progress->reckoned = -1e300;
    (void)pthread_mutex_unlock(&progress->mutex);
}

/* The stage under way tells how far it is, by its own reckoning or by its phase. */
static void tell(struct kiln_progress *progress, double now)
{
    struct kiln_time_left *whole = &progress->whole;
    double share = share_of_phase(progress), left = left_of_phase(progress);
    if (progress->reckoning != NULL) {
        if (now - progress->reckoned < REDRAW_SECONDS)
            return;
        progress->reckoned = now;
        left = progress->reckoning(progress->reckoning_data, share);
        const double spent = now - whole->since;
        share = left >= 0.0 && spent + left > 0.0 ? spent / (spent + left) : -1.0;
    }
    kiln_time_left_tell(whole, share, left, now);
}

void kiln_progress_phase(struct kiln_progress *progress, const char *name, uint64_t total)
{
    if (progress == NULL)
        return;
    (void)pthread_mutex_lock(&progress->mutex);
    (void)snprintf(progress->name, sizeof progress->name, "%s", name);
    progress->total = total;
    progress->done = progress->rate_done = 0;
    progress->rate = 0;
    progress->running = true;
    progress->phase_start = progress->rate_time = progress->clock(progress->clock_data);
    kiln_time_left_phase(&progress->whole, name, progress->phase_start);
    tell(progress, progress->phase_start);
    show(progress, progress->phase_start);
    (void)pthread_mutex_unlock(&progress->mutex);
}

/* Exponential moving average of the rate, so that the remaining time follows changes of speed smoothly. */
static void update_rate(struct kiln_progress *progress, double now)
{
    const double elapsed = now - progress->rate_time;
    if (elapsed < REDRAW_SECONDS || progress->done <= progress->rate_done)
        return;
    const double rate = (double)(progress->done - progress->rate_done) / elapsed;
    const double weight = elapsed / (elapsed + RATE_MEMORY_SECONDS);
    progress->rate = progress->rate > 0 ? progress->rate + weight * (rate - progress->rate) : rate;
    progress->rate_time = now;
    progress->rate_done = progress->done;
}

void kiln_progress_advance(struct kiln_progress *progress, uint64_t done)
{
    if (progress == NULL)
        return;
    (void)pthread_mutex_lock(&progress->mutex);
    if (progress->running) {
        const double now = progress->clock(progress->clock_data);
        const uint64_t possible = progress->total > 0 && done > progress->total ? progress->total : done;
        progress->done = possible > progress->done ? possible : progress->done;
        update_rate(progress, now);
        tell(progress, now);
        show(progress, now);
    }
    (void)pthread_mutex_unlock(&progress->mutex);
}

void kiln_progress_make_room(struct kiln_progress *progress)
{
    if (progress == NULL)
        return;
    (void)pthread_mutex_lock(&progress->mutex);
    const bool running = progress->running;
    end_line(progress);
    progress->running = running;
    (void)pthread_mutex_unlock(&progress->mutex);
}

void kiln_progress_finish(struct kiln_progress *progress)
{
    if (progress == NULL)
        return;
    (void)pthread_mutex_lock(&progress->mutex);
    kiln_time_left_end(&progress->whole, progress->clock(progress->clock_data));
    end_line(progress);
    (void)pthread_mutex_unlock(&progress->mutex);
}

/* ---- tables ---- */

static size_t character_count(const char *text)
{
    size_t count = 0;
    for (; *text != '\0'; text++)
        count += ((unsigned char)*text & 0xc0) != 0x80;
    return count;
}

void kiln_table_print(FILE *stream, const char *const *cells, size_t rows, size_t columns, uint32_t right)
{
    char plain[1024];
    for (size_t row = 0; row < rows; row++) {
        size_t pending = 0; /* spaces to print before the next cell that is not empty */
        for (size_t column = 0; column < columns; column++) {
            size_t width = 0;
            for (size_t i = 0; i < rows; i++) {
                const char *other = cells[i * columns + column];
                const size_t length = other != NULL ? character_count(kiln_text_plain(plain, sizeof plain, other)) : 0;
                width = length > width ? length : width;
            }
            const char *cell = kiln_text_plain(
                plain, sizeof plain, cells[row * columns + column] != NULL ? cells[row * columns + column] : "");
            const size_t padding = width - character_count(cell);
            const bool to_right = column < 32 && (right >> column & 1) != 0;
            pending += to_right ? padding : 0;
            if (cell[0] != '\0') {
                (void)fprintf(stream, "%*s%s", (int)pending, "", cell);
                pending = 0;
            }
            pending += (to_right ? 0 : padding) + 2;
        }
        (void)fputc('\n', stream);
    }
}
