// The page's end of its link to the program: messages both ways, one clock, and a new attempt when the link is gone.
//
//   const link = foveate({ opened() {}, text(words) {}, closed(why) {} });
//   link.send("words");
//   link.hostTime(performance.now())   // the same moment on the program's clock [ms]
//   link.uncertainty()                 // half the shortest recent round trip [ms]: the clock cannot be off by more
//
// The clock is compared as NTP does: the program answers "ping T" with "pong T H", H its own time. The answer with the shortest round trip of the last
// sixteen counts.

function foveate(heard) {
  const PING_MS = 500;
  const KEPT = 16;
  let socket = null;
  let exchanges = [];
  let wait = 250;

  function best() {
    return exchanges.reduce((a, b) => (b.trip < a.trip ? b : a), { trip: Infinity, offset: 0 });
  }

  function ping() {
    if (socket && socket.readyState === WebSocket.OPEN) socket.send("ping " + performance.now());
  }

  function take(words) {
    if (!words.startsWith("pong ")) {
      heard.text(words);
      return;
    }
    const now = performance.now();
    const [sent, host] = words.slice(5).split(" ").map(Number);
    exchanges.push({ trip: now - sent, offset: host - (sent + now) / 2 });
    if (exchanges.length > KEPT) exchanges.shift();
  }

  function open() {
    exchanges = [];
    socket = new WebSocket(new URL("socket", location.href).href.replace(/^http/, "ws"));
    socket.onopen = () => {
      wait = 250;
      // A few at once, so that the clock is known before the first picture.
      for (let i = 0; i < 4; i++) setTimeout(ping, 20 * i);
      heard.opened();
    };
    socket.onmessage = (event) => take(event.data);
    socket.onclose = (event) => {
      heard.closed(event.reason || "the program does not answer");
      setTimeout(open, wait);
      wait = Math.min(2 * wait, 4000);
    };
  }

  setInterval(ping, PING_MS);
  open();
  return {
    send(words) {
      if (socket && socket.readyState === WebSocket.OPEN) socket.send(words);
    },
    hostTime: (pageTime) => pageTime + best().offset,
    uncertainty: () => best().trip / 2,
    isSynchronised: () => exchanges.length > 0,
  };
}
