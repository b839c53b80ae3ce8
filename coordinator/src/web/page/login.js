// Sends the token; what comes back is a cookie that scripts cannot read.
const form = document.getElementById('login'), said = document.getElementById('said');

form.addEventListener('submit', async event => {
  event.preventDefault();
  const button = form.querySelector('button');
  button.disabled = true;
  said.textContent = '';
  try {
    const answer = await fetch('/login', { method: 'POST', headers: { 'X-Tessera': '1' }, body: document.getElementById('token').value });
    if (answer.ok) return location.replace('/' + location.hash);
    said.textContent = (await answer.json().catch(() => ({}))).error ?? answer.statusText;
  } catch {
    said.textContent = 'The farm does not answer.';
  }
  button.disabled = false;
});
