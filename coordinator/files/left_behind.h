/* List of the files that this process would leave behind if a signal ended it now: temporary files that do not have
 * their final name yet (publish.h), and locks. A signal handler removes them (kiln_left_remove).
 *
 * The list is global, since a signal handler gets no argument. It only grows; an entry whose file is gone is reused.
 * A handler may walk the list at any moment, and takes no lock. SIGKILL and a power cut leave the files in place; their
 * names are derived from those of the results, so that the same command replaces them.
 */
#ifndef KILN_COORDINATOR_FILES_LEFT_BEHIND_H
#define KILN_COORDINATOR_FILES_LEFT_BEHIND_H

struct kiln_left;

/* Adds the file `name` (copied, shorter than 544 bytes) of the open folder `folder`, which must stay open until
 * kiln_left_forget. NULL if memory is short: then the file may stay. Thread-safe. */
struct kiln_left *kiln_left_note(int folder, const char *name);
/* Removes the file's entry once the file has its final name or is gone, and sets the pointer NULL. NULL is allowed.
 * Thread-safe. */
void kiln_left_forget(struct kiln_left **left);

/* Removes all files of the list. For signal handlers; changes errno. */
void kiln_left_remove(void);

#endif
