// What a message costs in GStreamer through a chain of pass-through elements: one buffer in flight, median over COUNT of them.
//
//   gstreamer_hop LENGTH SIZE COUNT [queue]
//
// appsrc ! LENGTH x identity ! fakesink, all of it on the one streaming thread of appsrc; with `queue`, each identity is
// followed by a queue, and so by a change of threads. Prints nanoseconds from push to arrival; the slope between two
// lengths cancels what the ends cost.

#include <gst/app/gstappsrc.h>
#include <gst/gst.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static atomic_long arrived;
static atomic_llong arrived_ns;

static long long now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

static GstPadProbeReturn on_buffer(GstPad *pad, GstPadProbeInfo *info, gpointer user) {
    (void)pad, (void)info, (void)user;
    atomic_store(&arrived_ns, now_ns());
    atomic_fetch_add(&arrived, 1);
    return GST_PAD_PROBE_OK;
}

static int by_value(const void *a, const void *b) {
    long long x = *(const long long *)a, y = *(const long long *)b;
    return (x > y) - (x < y);
}

int main(int argc, char **argv) {
    if (argc < 4) {
        fprintf(stderr, "expected LENGTH SIZE COUNT [queue]\n");
        return 2;
    }
    gst_init(NULL, NULL);
    int length = atoi(argv[1]);
    gsize size = strtoul(argv[2], NULL, 10);
    long count = atol(argv[3]);
    const char *element = argc > 4 && !strcmp(argv[4], "queue") ? " ! identity ! queue" : " ! identity";
    GString *text = g_string_new("appsrc name=in max-bytes=0 format=bytes");
    for (int i = 0; i < length; i++) g_string_append(text, element);
    g_string_append(text, " ! fakesink name=out sync=false async=false");
    GError *error = NULL;
    GstElement *pipeline = gst_parse_launch(text->str, &error);
    if (!pipeline || error) {
        fprintf(stderr, "%s\n", error ? error->message : "no pipeline");
        return 1;
    }
    GstElement *in = gst_bin_get_by_name(GST_BIN(pipeline), "in");
    GstElement *out = gst_bin_get_by_name(GST_BIN(pipeline), "out");
    GstPad *pad = gst_element_get_static_pad(out, "sink");
    gst_pad_add_probe(pad, GST_PAD_PROBE_TYPE_BUFFER, on_buffer, NULL, NULL);
    gst_element_set_state(pipeline, GST_STATE_PLAYING);
    GstBuffer *buffer = gst_buffer_new_allocate(NULL, size, NULL);
    long long *took = calloc(count, sizeof *took);
    for (long i = 0; i < count; i++) {
        long long start = now_ns();
        gst_app_src_push_buffer(GST_APP_SRC(in), gst_buffer_ref(buffer));
        while (atomic_load(&arrived) <= i) {}
        took[i] = atomic_load(&arrived_ns) - start;
    }
    qsort(took, count, sizeof *took, by_value);
    printf("%lld\n", took[count / 2]);
    gst_element_set_state(pipeline, GST_STATE_NULL);
    return 0;
}
